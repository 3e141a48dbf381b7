"""Who may say, hear and ask what over a link that leaves a board, and how much, as rules for Zenoh. Pure.

A role is the common name of a certificate. Only the role of the command center says commands; the modules of the laptop
say what is theirs; people's side hears everything. An answer may be long, so only who must know what was said before
may ask for it: a viewer has what comes from then on. Zenoh judges the link, not the first sender: what a laptop's
client says is what the laptop says. On loopback the modules of one board trust each other.
"""

from __future__ import annotations

from typing import Any

from common.frames import MESSAGE_BYTES_MAX, QUESTION_BYTES_MAX
from common.messages import LAPTOP_RECORDED, ROBOT_SENDERS, TOPICS, Stance, Topic

# Common name of a certificate -> the modules that speak with it
ROLES: dict[str, tuple[str, ...]] = {
    "robot": tuple(module for module in ROBOT_SENDERS if module != "poi"),
    "pi": ("poi",),
    "laptop": ("recorder", "visualizer", "command_center"),
    "command_center": ("command_center",),
    "viewer": (),
}
_ON_BOARD = ("robot", "pi")
_COMMANDER = "command_center"
_RECORDER = "recorder"

# Of one topic over one link; many more than all who are behind it ask when each of them has missed something
QUESTIONS_HZ = 20.0

# What goes towards those who listen, and what goes towards those who speak
_TELLING = ["put", "delete", "reply", "declare_queryable", "liveliness_token"]
_HEARING = ["declare_subscriber", "declare_liveliness_subscriber"]
_ASKING = ["query"]

# Every address of a board but this one can be reached from outside
_LOOPBACK = {"link_protocols": ["tcp"], "interfaces": ["lo", "lo0"]}

Rules = dict[str, Any]  # by the section of Zenoh's configuration


def role_of(module: str) -> str:
    """The role whose certificate a module shows where its link leaves the board; "robot" for what is no module."""
    if module == _COMMANDER:
        return _COMMANDER
    return next((role for role, modules in ROLES.items() if module in modules), "robot")


def may_command(role: str) -> bool:
    """Whether links of that role may carry commands to the robot, or from it to who obeys them."""
    return role in (_COMMANDER, "robot")


def alive_key(module: str) -> str:
    """Where a module's liveliness token stands, without the robot's name."""
    return f"{module}/alive"


def said_keys(role: str) -> list[str]:
    """Keys that a role may say, without the robot's name."""
    if role == _COMMANDER:
        return [topic.key for topic in TOPICS if topic.is_command]
    modules = ROLES[role]
    said = [topic.key for topic in TOPICS if topic.producer in modules and not topic.is_command]
    return said + [alive_key(module) for module in modules]


def heard_keys(role: str) -> list[str]:
    """Keys that a role may hear, each by itself: people hear every topic, a board what its modules read."""
    heard = [topic.key for topic in TOPICS if role not in _ON_BOARD or _reads(role, topic)]
    return heard + [alive_key("*")] if ROLES[role] else heard


def asked_keys(role: str) -> list[str]:
    """Keys that a role may ask for what was said before: states that its modules read, and what it records."""
    records = LAPTOP_RECORDED if _RECORDER in ROLES[role] else ()
    return [topic.key for topic in TOPICS if topic in records or (topic.stance is Stance.STATE and _reads(role, topic))]


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
    """For the recorder's router: what is on the laptop speaks as the laptop, the robot as it likes."""
    rules = [_everything(robot), *_rules_of(robot, "laptop")]
    subjects = [{"id": "loopback", **_LOOPBACK}, _certified("robot")]
    policies = [_policy("everything", "robot"), {"rules": [rule["id"] for rule in rules[1:]], "subjects": ["loopback"]}]
    return _access_control(rules, subjects, policies)


def _everything(robot: str) -> Rules:
    return _rule("everything", ["ingress", "egress"], [*_TELLING, *_HEARING, *_ASKING], [f"{robot}/**"])


def _rules_of(robot: str, role: str) -> list[Rules]:
    """Inwards it tells what it may say, hears and asks; outwards it is the other way round."""
    said, heard, asked = (
        [f"{robot}/{key}" for key in keys] for keys in (said_keys(role), heard_keys(role), asked_keys(role))
    )
    rules = [
        _rule(f"{role} tells", ["ingress"], _TELLING, said),
        _rule(f"{role} is heard", ["egress"], [*_HEARING, *_ASKING], said),
        _rule(f"{role} hears", ["ingress"], _HEARING, heard),
        _rule(f"{role} asks", ["ingress"], _ASKING, asked),
        _rule(f"{role} is told", ["egress"], _TELLING, heard),
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
    """What of all that is allowed comes through from outside: a flood, or a giant, ends at the router."""
    inwards = {"flows": ["ingress"], "link_protocols": ["tls"]}
    asked = dict.fromkeys(key for role in ROLES for key in asked_keys(role))
    questions = [{"key_expr": f"{robot}/{key}", "freq": QUESTIONS_HZ} for key in asked]
    sizes = ((["query"], QUESTION_BYTES_MAX), (["put", "reply"], MESSAGE_BYTES_MAX))
    return {
        "downsampling": [{**inwards, "messages": _ASKING, "rules": questions}],
        "low_pass_filter": [
            {**inwards, "messages": messages, "key_exprs": [f"{robot}/**"], "size_limit": limit_bytes}
            for messages, limit_bytes in sizes
        ],
    }
