"""Stop, release and resume in every order: nothing moves after a stop that was not released and resumed."""

from __future__ import annotations

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from tests.unit.stop_model import World, interleaving

LENGTH = 60
SEEDS = 20_000


@pytest.mark.requirement("CAR_MR_05", "CC_MR_04")
@pytest.mark.parametrize("part", range(4))
def test_no_interleaving_of_what_people_do_and_what_fails_moves_a_stopped_robot(part: int) -> None:
    returns = sum(interleaving(seed, LENGTH) for seed in range(part * SEEDS // 4, (part + 1) * SEEDS // 4))
    assert returns > SEEDS // 100, "and it does move again, after a release and a resume"


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_nor_does_one_in_a_million() -> None:
    for seed in range(10**6):
        interleaving(seed, LENGTH)


class StopWorld(RuleBasedStateMachine):
    """The same world in hypothesis's hands, which looks for what is short and comes back to what failed."""

    @initialize()
    def begin(self) -> None:
        self.world = World()
        self.world.settle(3)

    @rule(
        name=st.sampled_from(
            ["settle", "publish_permit", "write", "hear_board", "report", "command", "next_tick", "press"]
            + ["push_button", "kill_comm", "start_comm", "kill_bridge", "start_bridge", "reset_board", "cut_power"]
            + ["lose_record"]
        )
    )
    def happens(self, name: str) -> None:
        getattr(self.world, name)()

    @rule(name=st.sampled_from(["deliver_comm", "deliver_bridge"]), which=st.integers(0, 3), keep=st.booleans())
    def arrives(self, name: str, which: int, keep: bool) -> None:
        getattr(self.world, name)(which, keep)

    @rule(name=st.sampled_from(["release", "resume"]), which=st.integers(0, 3))
    def somebody_says(self, name: str, which: int) -> None:
        getattr(self.world, name)(which)

    @rule(lost=st.booleans())
    def line_arrives(self, lost: bool) -> None:
        self.world.deliver_board(lost)

    @invariant()
    def what_is_granted_is_on_the_disk(self) -> None:
        comm = self.world.comm
        if comm is not None and comm.may_grant:
            assert self.world.disk == comm.record


StopWorld.TestCase.settings = settings(max_examples=150, stateful_step_count=40, deadline=None)
test_hypothesis_finds_none_either = StopWorld.TestCase
