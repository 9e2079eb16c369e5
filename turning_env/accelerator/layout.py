"""How a block's records look to a thread of the accelerator, which works on one lane of it.

The transition reads ``lanes.path[i]`` of a block's record. A thread is given a record that begins at its lane's first number and
whose arrays are one lane long, so that with ``i`` = 0 it reads and writes its own lane where it stands in the block. The threads
of a warp are the lanes of a block, and read its neighbouring numbers together.
"""

from typing import Any

import numpy as np

from turning_env.records import WIDTH

_NUMBER = 8  # bytes of each of a lane's numbers


def lane_of(block: np.dtype[Any]) -> np.dtype[Any]:
    """The type of one lane of a block in place: the block's fields where they are, of which it takes the first number.

    Raises:
        ValueError: the block holds something else than arrays of 8 bytes per lane.
    """
    formats, offsets = [], []
    for name in block.names or ():
        kind, offset = block.fields[name][:2]  # type: ignore[index]
        if kind.shape != (WIDTH,) or kind.base.itemsize != _NUMBER:
            raise ValueError(f"field {name} is {kind}, but must be of {WIDTH} lanes with {_NUMBER} bytes each")
        formats.append((kind.base, (1,)))
        offsets.append(offset)
    fields: Any = {"names": block.names, "formats": formats, "offsets": offsets, "itemsize": max(offsets) + _NUMBER}
    lane: np.dtype[Any] = np.dtype(fields, align=True)
    return lane


def aligned(record: np.dtype[Any]) -> np.dtype[Any]:
    """The same fields, each on a boundary of its own size: others would be read byte by byte."""
    if record.names is None:
        return record
    return np.dtype([(name, aligned(record[name])) for name in record.names], align=True)


def put(target: Any, source: Any) -> None:
    """Copy the values of a record to one of the same fields, wherever these stand."""
    for name in target.dtype.names:
        if target.dtype[name].names:
            put(target[name], source[name])
        else:
            target[name] = source[name]


def lanes_in(blocks: Any, lane: np.dtype[Any]) -> Any:
    """The lanes of blocks that are in the accelerator's memory, shape (blocks, WIDTH), each as ``lane_of`` has it."""
    return seen_as(blocks, (blocks.shape[0], WIDTH), (blocks.dtype.itemsize, _NUMBER), lane)


def fields_in(blocks: Any) -> Any:
    """The numbers of blocks whose fields are all float64, likewise: shape (blocks, fields, WIDTH)."""
    shape = blocks.shape[0], len(blocks.dtype.names), WIDTH
    return seen_as(blocks, shape, (blocks.dtype.itemsize, WIDTH * _NUMBER, _NUMBER), np.dtype(np.float64))


def seen_as(array: Any, shape: tuple[int, ...], strides: tuple[int, ...], kind: np.dtype[Any]) -> Any:
    """An array of Numba's in other words: the same memory, from its beginning."""
    maker: Any = type(array)
    if hasattr(array, "gpu_data"):
        return maker(shape=shape, strides=strides, dtype=kind, gpu_data=array.gpu_data)
    return maker(np.ndarray(shape, kind, array.data, 0, strides))  # the simulator's, which lies in the main memory
