"""A small MTConnect agent for tests: it numbers observations and keeps the last ones.

Its documents have the structure of those of the standard's own agent (mtconnect/cppagent).
"""

import contextlib
import threading
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, NamedTuple
from urllib.parse import parse_qs, urlsplit

START = datetime(2026, 3, 2, 8, 0, tzinfo=UTC)

PROBE = """<?xml version="1.0" encoding="UTF-8"?>
<MTConnectDevices xmlns="urn:mtconnect.org:MTConnectDevices:1.7">
  <Header creationTime="2026-03-02T08:00:00Z" sender="lathe" instanceId="1" version="1.7.0"
    bufferSize="131072"/>
  <Devices>
    <Device id="d1" name="Lathe 1" uuid="000-1">
      <Components>
        <Axes id="ax" name="base"><Components>
          <Linear id="x" name="X"><DataItems>
            <DataItem category="SAMPLE" id="xpm" type="POSITION" subType="ACTUAL"
              coordinateSystem="MACHINE" units="MILLIMETER"/>
            <DataItem category="SAMPLE" id="xp" type="POSITION" subType="ACTUAL"
              coordinateSystem="WORK" units="MILLIMETER"/>
            <DataItem category="SAMPLE" id="xl" type="LOAD" units="PERCENT"/>
            <DataItem category="CONDITION" id="xlc" type="LOAD"/>
          </DataItems></Linear>
          <Linear id="z" name="Z"><DataItems>
            <DataItem category="SAMPLE" id="zl" type="LOAD" units="PERCENT"/>
          </DataItems></Linear>
          <Rotary id="c" name="C"><DataItems>
            <DataItem category="SAMPLE" id="sc" type="ROTARY_VELOCITY" subType="COMMANDED"
              units="REVOLUTION/MINUTE"/>
            <DataItem category="SAMPLE" id="sa" type="ROTARY_VELOCITY" subType="ACTUAL"
              units="REVOLUTION/MINUTE"/>
            <DataItem category="SAMPLE" id="sl" type="LOAD" subType="ACTUAL" units="PERCENT"/>
            <DataItem category="SAMPLE" id="sw" type="WATTAGE" units="WATT"/>
          </DataItems></Rotary>SECOND
        </Components></Axes>
        <Controller id="cn" name="cn"><Components>
          <Path id="p" name="path"><DataItems>
            <DataItem category="SAMPLE" id="pf" type="PATH_FEEDRATE" subType="ACTUAL"
              units="MILLIMETER/SECOND"/>
            <DataItem category="EVENT" id="fo" type="PATH_FEEDRATE_OVERRIDE" subType="PROGRAMMED"/>
            <DataItem category="EVENT" id="ex" type="EXECUTION"/>
            <DataItem category="EVENT" id="tn" type="TOOL_NUMBER"/>
          </DataItems></Path>
        </Components></Controller>
      </Components>
    </Device>
  </Devices>
</MTConnectDevices>"""
SECOND_SPINDLE = """<Rotary id="c2" name="C2"><DataItems>
  <DataItem category="SAMPLE" id="s2" type="ROTARY_VELOCITY" subType="ACTUAL"
    units="REVOLUTION/MINUTE"/>
</DataItems></Rotary>"""


class Observation(NamedTuple):
    """A value of a data item."""

    seconds: float  # since ``START``
    item: str
    value: str


class Agent:
    """The state of an agent."""

    def __init__(self) -> None:
        self.instance = 1
        self.first = 1
        self.spindles = 1
        self.knows_next = True  # whether the next observation may be asked for before it comes
        self.observations: list[Observation] = []  # the first has the number 1
        self.requests: list[str] = []  # methods and paths
        self.answer: bytes | None = None  # to everything, in place of its own

    def observe(self, seconds: float, values: Mapping[str, float | str]) -> None:
        for item, value in values.items():
            self.observations.append(Observation(seconds, item, str(value)))

    def restart(self) -> None:
        self.instance += 1
        self.first = 1
        self.observations = []

    def document(self, path: str, query: dict[str, list[str]]) -> bytes:
        """Return the answer to a request."""
        if self.answer is not None:
            return self.answer
        if path == "/probe":
            second = SECOND_SPINDLE if self.spindles == 2 else ""
            return PROBE.replace("SECOND\n", f"{second}\n", 1).encode()
        count = len(self.observations)
        if path == "/Lathe%201/current":
            last = int(query.get("at", [str(count)])[0])
            if not self.first <= last <= count:
                return self._error()
            newest = {}
            for number, observation in enumerate(self.observations[:last], 1):
                newest[observation.item] = (number, observation)
            return self._streams(list(newest.values()), count + 1)
        start = int(query["from"][0])
        if not self.first <= start <= count + self.knows_next:
            return self._error()
        end = min(start + int(query["count"][0]), count + 1)
        numbered = [(number, self.observations[number - 1]) for number in range(start, end)]
        return self._streams(numbered, end)

    def _streams(self, numbered: list[tuple[int, Observation]], next_number: int) -> bytes:
        elements = []
        for number, (seconds, item, value) in numbered:
            moment = (START + timedelta(seconds=seconds)).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
            elements.append(
                f'<V dataItemId="{item}" timestamp="{moment}" sequence="{number}">{value}</V>'
            )
        seconds = self.observations[-1].seconds if self.observations else 0.0
        created = (START + timedelta(seconds=seconds)).isoformat()
        return f"""<?xml version="1.0" encoding="UTF-8"?>
<MTConnectStreams xmlns="urn:mtconnect.org:MTConnectStreams:1.7">
  <Header creationTime="{created}" sender="lathe" instanceId="{self.instance}"
    version="1.7.0" bufferSize="131072" nextSequence="{next_number}" firstSequence="{self.first}"
    lastSequence="{len(self.observations)}"/>
  <Streams><DeviceStream name="Lathe 1" uuid="000-1"><ComponentStream component="Path">
  <Samples>{"".join(elements)}</Samples>
  </ComponentStream></DeviceStream></Streams>
</MTConnectStreams>""".encode()

    def _error(self) -> bytes:
        return f"""<?xml version="1.0" encoding="UTF-8"?>
<MTConnectError xmlns="urn:mtconnect.org:MTConnectError:1.7">
  <Header creationTime="2026-03-02T08:00:00Z" sender="lathe" instanceId="{self.instance}"
    version="1.7.0" bufferSize="131072"/>
  <Errors><Error errorCode="OUT_OF_RANGE">'from' must be at least {self.first}</Error></Errors>
</MTConnectError>""".encode()


@contextlib.contextmanager
def serving(agent: Agent, port: int = 0) -> Iterator[str]:
    """Yield the address at which an agent answers."""

    class Handler(BaseHTTPRequestHandler):
        def __getattr__(self, name: str) -> Any:
            if name.startswith("do_"):
                return self.serve  # every method is recorded
            raise AttributeError(name)

        def serve(self) -> None:
            parts = urlsplit(self.path)
            agent.requests.append(f"{self.command} {parts.path}")
            document = agent.document(parts.path, parse_qs(parts.query))
            self.send_response(404 if b"<MTConnectError" in document else 200)
            self.send_header("Content-Type", "text/xml")
            self.send_header("Content-Length", str(len(document)))
            self.end_headers()
            self.wfile.write(document)

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", port), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}"
        finally:
            server.shutdown()
            thread.join()
