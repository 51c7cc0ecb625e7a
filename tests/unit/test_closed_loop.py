"""With the chain the robot touches nothing that its laser could see; without it it does.

Each run drives in other worlds; CLOSED_LOOP_SEED makes it the same ones again, CLOSED_LOOP_WORLDS more of them.
"""

import os
import random

import pytest

from tests.closed_loop import VARIANTS, Loop, run

SEED = int(os.environ.get("CLOSED_LOOP_SEED") or random.SystemRandom().randrange(10**9))
WORLDS = int(os.environ.get("CLOSED_LOOP_WORLDS") or 20)


@pytest.mark.timeout(120 + WORLDS)
@pytest.mark.parametrize("name", [name for name, variant in VARIANTS.items() if variant.chain])
def test_with_the_chain_nothing_is_touched(name: str) -> None:
    worlds = max(1, WORLDS // 4) if VARIANTS[name].corners else WORLDS  # these take longer
    result = run(VARIANTS[name], SEED, worlds)
    again = f"again by CLOSED_LOOP_SEED={SEED} CLOSED_LOOP_WORLDS={WORLDS}"
    assert not result.touches, f"{name}: touched in the drives of the seeds {result.touches}; {again}"
    assert result.driven > 0.1 * worlds, f"{name}: it has hardly moved; {again}"


def test_without_the_chain_things_are_touched() -> None:
    result = run(VARIANTS["without"], SEED, WORLDS)
    assert len(result.touches) > WORLDS / 5, f"CLOSED_LOOP_SEED={SEED}"


def test_the_same_seed_is_the_same_drive() -> None:
    variant = VARIANTS["missing rays"]
    assert Loop(variant, SEED).drive() == Loop(variant, SEED).drive()
