"""Rights of the roles follow from the message table; sessions join where the configuration says."""

from __future__ import annotations

from fnmatch import fnmatch
from typing import Any

import pytest

from common.access import ROLES, laptop_rules, published_keys, queried_keys, robot_rules, role_of, subscribed_keys
from common.messages.topics import DOOR, OPERATION, STOP, TOPICS, QosProfile
from common.modules import ROBOT_SENDERS

COMMANDS = {DOOR.key, STOP.key, OPERATION.key}


def test_only_the_command_center_says_commands() -> None:
    assert {topic.key for topic in TOPICS if topic.is_command} == COMMANDS
    for role in ROLES:
        said = COMMANDS & set(published_keys(role))
        assert said == (COMMANDS if role == "command_center" else set()), role


def test_every_topic_that_crosses_a_link_is_said_by_one_role_and_heard_by_its_consumers() -> None:
    for topic in TOPICS:
        if topic.producer == "clock":
            continue
        publishers = [role for role in ROLES if topic.key in published_keys(role)]
        assert len(publishers) == 1, topic.key
        for consumer in topic.consumers:
            role = role_of(consumer)
            assert role in publishers or any(fnmatch(topic.key, key) for key in subscribed_keys(role)), (
                topic.key,
                consumer,
            )


def test_a_viewer_publishes_nothing_and_a_board_receives_only_what_it_reads() -> None:
    assert published_keys("viewer") == []
    assert "command_center/operation" not in subscribed_keys("pi")
    assert "mmu/pose" in subscribed_keys("pi")


def test_tokens_are_said_by_their_own_role_only() -> None:
    for module in ROBOT_SENDERS:
        assert [role for role in ROLES if f"{module}/alive/**" in published_keys(role)] == [
            "pi" if module == "poi" else "robot"
        ]


def test_only_who_reads_a_state_or_records_may_ask_for_what_was_said() -> None:
    states = {topic.key for topic in TOPICS if topic.qos is QosProfile.STATE}
    assert queried_keys("viewer") == []
    assert queried_keys("pi") == ["mmu/map", "mmu/grid", "mmu/trajectory"]
    assert set(queried_keys("command_center")) == states - {"mmu/grid"}
    assert states | COMMANDS <= set(queried_keys("laptop"))
    assert "mmu/pose" not in queried_keys("laptop")


def test_every_key_that_may_be_heard_is_one_topic() -> None:
    """Of subscriptions with a name each nobody can make more than there are topics."""
    for role in ROLES:
        wild = [key for key in subscribed_keys(role) if "*" in key]
        assert wild == ([] if role == "viewer" else ["*/alive/**"])


@pytest.mark.parametrize("rules", [robot_rules("r"), laptop_rules("r")])
def test_what_is_not_allowed_is_denied(rules: dict[str, Any]) -> None:
    rules = rules["access_control"]
    assert rules["enabled"] is True
    assert rules["default_permission"] == "deny"
    names = {rule["id"] for rule in rules["rules"]}
    assert names == {name for policy in rules["policies"] for name in policy["rules"]}
    assert all(key.startswith("r/") for rule in rules["rules"] for key in rule["key_exprs"])
