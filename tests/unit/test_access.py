"""Rights of the roles follow from the message table; sessions join where the configuration says."""

from __future__ import annotations

from fnmatch import fnmatch
from typing import Any

import pytest

from common.access import ROLES, heard_keys, laptop_rules, robot_rules, role_of, said_keys
from common.messages import OPERATION, ROBOT_SENDERS, STOP, TOPICS

COMMANDS = {STOP.key, OPERATION.key}


def test_only_the_command_center_says_commands() -> None:
    assert {topic.key for topic in TOPICS if topic.is_command} == COMMANDS
    for role in ROLES:
        said = COMMANDS & set(said_keys(role))
        assert said == (COMMANDS if role == "command_center" else set()), role


def test_every_topic_that_crosses_a_link_is_said_by_one_role_and_heard_by_its_consumers() -> None:
    for topic in TOPICS:
        if topic.producer == "clock":
            continue
        sayers = [role for role in ROLES if topic.key in said_keys(role)]
        assert len(sayers) == 1, topic.key
        for consumer in topic.consumers:
            role = role_of(consumer)
            assert role in sayers or any(fnmatch(topic.key, key) for key in heard_keys(role)), (topic.key, consumer)


def test_a_viewer_says_nothing_and_a_board_hears_only_what_it_reads() -> None:
    assert said_keys("viewer") == []
    assert "command_center/operation" not in heard_keys("pi")
    assert "mmu/pose" in heard_keys("pi")


def test_tokens_are_said_by_their_own_role_only() -> None:
    for module in ROBOT_SENDERS:
        assert [role for role in ROLES if f"{module}/alive" in said_keys(role)] == [
            "pi" if module == "poi" else "robot"
        ]


@pytest.mark.parametrize("rules", [robot_rules("r"), laptop_rules("r")])
def test_what_is_not_allowed_is_denied(rules: dict[str, Any]) -> None:
    assert rules["enabled"] is True
    assert rules["default_permission"] == "deny"
    names = {rule["id"] for rule in rules["rules"]}
    assert names == {name for policy in rules["policies"] for name in policy["rules"]}
    assert all(key.startswith("r/") for rule in rules["rules"] for key in rule["key_exprs"])
