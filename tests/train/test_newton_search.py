"""The search for the greatest gain within bounds, against gains whose tops are known."""

import torch

from train.newton_search import Slopes, search

Tensor = torch.Tensor


def parabola(top: tuple[float, float]):  # type: ignore[no-untyped-def]
    """Return a parabola with its top there, whose axes are not those of x and y."""

    def gain(x: Tensor, y: Tensor) -> Slopes:
        dx, dy, one = x - top[0], y - top[1], torch.ones_like(x)
        value = -(dx.square() + dx * dy + dy.square())
        return Slopes(value, -(2.0 * dx + dy), -(dx + 2.0 * dy), -2.0 * one, -one, -2.0 * one)

    return gain


def cliff(x: Tensor, y: Tensor) -> Slopes:
    """Return a gain that rises up to x + y = 1 and then falls steeply, with a slight preference for small x."""
    scale, price = 0.01, 10.0
    over = (x + y - 1.0) / scale
    chance, safe = torch.sigmoid(over), torch.sigmoid(-over)
    bend = -price * chance * safe / scale
    value = x + y - x.square() + price * scale * torch.log(safe)
    return Slopes(value, 1.0 - 2.0 * x - price * chance, 1.0 - price * chance, bend - 2.0, bend, bend)


def pair(x: float, y: float) -> tuple[Tensor, Tensor]:
    return torch.tensor([x]).double(), torch.tensor([y]).double()


def test_the_top_of_a_parabola_is_found_in_one_step_and_kept() -> None:
    found = search(parabola((0.3, -0.2)), pair(0.0, 0.0), pair(-1.0, -1.0), pair(1.0, 1.0))
    torch.testing.assert_close((found.x, found.y), pair(0.3, -0.2), rtol=0.0, atol=1e-5)


def test_bounds_hold_and_the_free_value_lies_beyond_them() -> None:
    found = search(parabola((0.3, 0.8)), pair(0.0, 0.0), pair(-1.0, -1.0), pair(1.0, 0.5))
    best_x = 0.3 - 0.5 * (0.5 - 0.8)
    torch.testing.assert_close((found.x, found.y), pair(best_x, 0.5), rtol=0.0, atol=1e-5)
    free = 0.8 - 0.5 * (best_x - 0.3)
    torch.testing.assert_close((found.free_y, found.slope), pair(free, -0.5), rtol=0.0, atol=1e-5)


def test_a_cliff_is_followed_to_the_best_place_along_it() -> None:
    found = search(cliff, pair(0.3, 0.7), pair(-1.0, -1.0), pair(2.0, 2.0))
    assert abs(found.x.item()) < 0.01
    here = cliff(found.x, found.y)
    assert max(abs(here.x.item()), abs(here.y.item())) < 0.05


def test_a_search_beyond_a_cliff_comes_back() -> None:
    found = search(cliff, pair(0.5, 1.0), pair(-1.0, -1.0), pair(2.0, 2.0))
    assert cliff(found.x, found.y).gain > cliff(*pair(0.5, 0.4)).gain
