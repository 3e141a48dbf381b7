"""Who may publish, subscribe and query what over a link that leaves a board, and how much, as rules for Zenoh. Pure.

A role is the common name of a certificate. Only the role of the command center publishes commands; the modules of the
laptop publish their own topics; the roles of people (laptop, command center, viewer) receive every topic. A reply may
be long, so only a role that must know earlier messages may query them: a viewer receives only new ones. Zenoh checks
the link, not the first sender: what a client of the laptop publishes counts as the laptop's. On loopback the modules of
one board trust each other.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from common.messages.topics import LAPTOP_RECORDED, TOPICS, QosProfile, Topic
from common.modules import COMMANDER, Board, on
from common.recording import QUERY_BYTES_MAX
from common.zenoh_channel import MESSAGE_BYTES_MAX

# Common name of a certificate -> the modules that connect with it
ROLES: dict[str, tuple[str, ...]] = {
    "robot": on(Board.MEGA, Board.BEAGLEBONE),
    "pi": on(Board.RASPBERRY),
    "laptop": on(Board.LAPTOP),
    "command_center": ("command_center",),
    "viewer": (),
}
_ON_BOARD = ("robot", "pi")

_RECORDER = "recorder"

# Of one topic over one link; many more than all modules behind it send when each of them has missed something
QUERIES_HZ = 20.0

# What goes towards subscribers, and what goes towards publishers
_PUBLISHING = ["put", "delete", "reply", "declare_queryable", "liveliness_token"]
_SUBSCRIBING = ["declare_subscriber", "declare_liveliness_subscriber"]
_QUERYING = ["query"]

# Every address of a board but this one can be reached from outside
_LOOPBACK = {"link_protocols": ["tcp"], "interfaces": ["lo", "lo0"]}

Rules = dict[str, Any]  # by the section of Zenoh's configuration


def role_of(module: str) -> str:
    """The role whose certificate a module shows where its link leaves the board; "robot" for what is no module."""
    if module == COMMANDER:
        return COMMANDER
    return next((role for role, modules in ROLES.items() if module in modules), "robot")


def may_command(role: str) -> bool:
    """Whether links of that role may carry commands to the robot, or from it to the modules that execute them."""
    return role in (COMMANDER, "robot")


def alive_key(module: str) -> str:
    """Where a module's liveliness token stands, without the robot's name; its release follows."""
    return f"{module}/alive"


def alive_keys(module: str) -> str:
    """Its tokens of whatever release; of all modules for "*"."""
    return f"{alive_key(module)}/**"


def published_keys(role: str) -> list[str]:
    """Keys that a role may publish, without the robot's name."""
    if role == COMMANDER:
        return [topic.key for topic in TOPICS if topic.is_command]
    modules = ROLES[role]
    published = _keys(topic for topic in TOPICS if topic.producer in modules and not topic.is_command)
    return published + [alive_keys(module) for module in modules]


def subscribed_keys(role: str) -> list[str]:
    """Keys that a role may subscribe, each by itself: people every topic, a board what its modules read."""
    subscribed = _keys(topic for topic in TOPICS if role not in _ON_BOARD or _reads(role, topic))
    return subscribed + [alive_keys("*")] if ROLES[role] else subscribed


def queried_keys(role: str) -> list[str]:
    """Keys that a role may query for what was published before: states that its modules read, and what it records."""
    records = LAPTOP_RECORDED if _RECORDER in ROLES[role] else ()
    return [
        topic.key for topic in TOPICS if topic in records or (topic.qos is QosProfile.STATE and _reads(role, topic))
    ]


def _keys(topics: Iterable[Topic[object]]) -> list[str]:
    """Of topics, and of the bundles in which they travel."""
    return list(dict.fromkeys(key for topic in topics for key in (topic.key, topic.bundle_key) if key))


def _reads(role: str, topic: Topic[object]) -> bool:
    return any(module in topic.consumers for module in ROLES[role])


def robot_rules(robot: str) -> Rules:
    """For comm's router, to which every other machine connects."""
    rules, policies = [_everything(robot)], [_policy("everything", "loopback")]
    for role in ROLES:
        if role != "robot":
            own = _rules_of(robot, role)
            rules += own
            policies.append({"rules": [rule["id"] for rule in own], "subjects": [role]})
    subjects = [{"id": "loopback", **_LOOPBACK}, *(_certified(role) for role in ROLES if role != "robot")]
    return _access_control(rules, subjects, policies) | _limits(robot)


def laptop_rules(robot: str) -> Rules:
    """For the recorder's router: what is on the laptop has the rights of the laptop, the robot has all."""
    rules = [_everything(robot), *_rules_of(robot, "laptop")]
    subjects = [{"id": "loopback", **_LOOPBACK}, _certified("robot")]
    policies = [_policy("everything", "robot"), {"rules": [rule["id"] for rule in rules[1:]], "subjects": ["loopback"]}]
    return _access_control(rules, subjects, policies)


def _everything(robot: str) -> Rules:
    return _rule("everything", ["ingress", "egress"], [*_PUBLISHING, *_SUBSCRIBING, *_QUERYING], [f"{robot}/**"])


def _rules_of(robot: str, role: str) -> list[Rules]:
    """Inwards it publishes, subscribes and queries what its role may; outwards it is the other way round."""
    published, subscribed, queried = (
        [f"{robot}/{key}" for key in keys] for keys in (published_keys(role), subscribed_keys(role), queried_keys(role))
    )
    rules = [
        _rule(f"{role} publishes", ["ingress"], _PUBLISHING, published),
        _rule(f"{role} is received", ["egress"], [*_SUBSCRIBING, *_QUERYING], published),
        _rule(f"{role} subscribes", ["ingress"], _SUBSCRIBING, subscribed),
        _rule(f"{role} queries", ["ingress"], _QUERYING, queried),
        _rule(f"{role} receives", ["egress"], _PUBLISHING, subscribed),
    ]
    return [rule for rule in rules if rule["key_exprs"]]


def _rule(name: str, flows: list[str], messages: list[str], keys: list[str]) -> Rules:
    return {"id": name, "permission": "allow", "flows": flows, "messages": messages, "key_exprs": keys}


def _certified(role: str) -> Rules:
    return {"id": role, "link_protocols": ["tls"], "cert_common_names": [role]}


def _policy(rule: str, subject: str) -> Rules:
    return {"rules": [rule], "subjects": [subject]}


def _access_control(rules: list[Rules], subjects: list[Rules], policies: list[Rules]) -> Rules:
    allowed = {"rules": rules, "subjects": subjects, "policies": policies}
    return {"access_control": {"enabled": True, "default_permission": "deny", **allowed}}


def _limits(robot: str) -> Rules:
    """Limits on rate and size of what is allowed from outside: the router drops a flood or an oversized message."""
    inwards = {"flows": ["ingress"], "link_protocols": ["tls"]}
    queried = dict.fromkeys(key for role in ROLES for key in queried_keys(role))
    queries = [{"key_expr": f"{robot}/{key}", "freq": QUERIES_HZ} for key in queried]
    sizes = ((["query"], QUERY_BYTES_MAX), (["put", "reply"], MESSAGE_BYTES_MAX))
    return {
        "downsampling": [{**inwards, "messages": _QUERYING, "rules": queries}],
        "low_pass_filter": [
            {**inwards, "messages": messages, "key_exprs": [f"{robot}/**"], "size_limit": limit_bytes}
            for messages, limit_bytes in sizes
        ],
    }
