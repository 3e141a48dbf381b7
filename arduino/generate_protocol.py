"""Writes both ends of the serial line from `protocol.toml`: the firmware's header and the bridge's module.

    python arduino/generate_protocol.py

The results are committed; a test compares them with the definition.
"""

from __future__ import annotations

import binascii
import json
import sys
import tomllib
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
DEFINITION = HERE / "protocol.toml"
HEADER = HERE / "indoor_mapping" / "src" / "core" / "protocol.h"
MODULE = HERE.parent / "onboard" / "bridge" / "protocol.py"

Message = dict[str, Any]


def protocol_hash(definition: dict[str, Any]) -> int:
    """CRC-16 over everything two ends must agree on; notes and rates do not count."""
    essence = [
        [m["type"], m["sender"], m["receiver"], m.get("number", 0)]
        + [[f["name"], f.get("count", 1), f["min"], f["max"]] for f in m["fields"]]
        for m in definition["message"]
    ]
    text = json.dumps([definition["version"], definition["stop_byte"], definition["enum"], essence])
    return binascii.crc_hqx(text.encode(), 0xFFFF)


def _name(message: Message) -> str:
    return str(message.get("name", message["type"].capitalize()))


def _c_int(value: int) -> str:
    return "(-2147483647 - 1)" if value == -(2**31) else str(value)


def _c_struct(message: Message) -> list[str]:
    lines = [f"// {message['sender']} -> {message['receiver']}, {message['rate']}", f"struct {_name(message)} {{"]
    for field in message["fields"]:
        size = f"[{field['count']}]" if "count" in field else ""
        note = ", ".join(field[key] for key in ("unit", "note") if key in field)
        lines.append(f"  int32_t {field['name']}{size};" + (f"  // {note}" if note else ""))
    return [*lines, "};"]


def _c_writer(message: Message) -> list[str]:
    lines = [f"inline void write(LineEncoder& line, const {_name(message)}& m, uint32_t now_ms) {{"]
    lines.append(f'  line.begin("{message["sender"]}", "{message["receiver"]}", now_ms, "{message["type"]}");')
    for field in message["fields"]:
        if "count" in field:
            lines.append(f"  for (uint8_t i = 0; i < {field['count']}; ++i) line.put_field(m.{field['name']}[i]);")
        else:
            lines.append(f"  line.put_field(m.{field['name']});")
    return [*lines, "}"]


def _c_reader(message: Message) -> list[str]:
    name = _name(message)
    parameter = " m" if message["fields"] else ""
    lines = [f"inline bool read(const char* fields, {name}*{parameter}) {{"]
    for field in message["fields"]:
        bounds = f"{_c_int(field['min'])}, {_c_int(field['max'])}"
        lines.append(f"  if (!read_field(&fields, {bounds}, &m->{field['name']})) return false;")
    return [*lines, "  return *fields == 0;", "}"]


def c_header(definition: dict[str, Any]) -> str:
    """The text of `protocol.h`."""
    lines = [
        "// Written by generate_protocol.py from protocol.toml; do not edit.",
        "#pragma once",
        "#include <stdint.h>",
        "",
        '#include "line_codec.h"',
        "",
        "namespace core {",
        "",
        f"static const uint16_t kProtocolVersion = {definition['version']};",
        f"static const uint16_t kProtocolHash = 0x{protocol_hash(definition):04X};",
        f"static const uint8_t kStopByte = 0x{definition['stop_byte']:02X};",
        "",
    ]
    for enum, members in definition["enum"].items():
        title = "".join(part.capitalize() for part in enum.split("_"))
        lines.append(f"enum {title} : uint8_t {{")
        prefix = enum.upper()
        lines += [f"  {prefix}_{member} = {value}," for member, value in members.items()]
        lines += ["};", ""]
    for message in definition["message"]:
        lines += _c_struct(message)
        if "number" in message:
            lines += [
                f"static const uint8_t k{_name(message)}Number = {message['number']};",
                f'static const char k{_name(message)}Type[] = "{message["type"]}";',
                *_c_reader(message),
            ]
        else:
            lines += _c_writer(message)
        lines.append("")
    lines += ["}  // namespace core", ""]
    return "\n".join(lines)


def python_module(definition: dict[str, Any]) -> str:
    """The text of `onboard/bridge/protocol.py`."""
    lines = [
        '"""The serial line\'s messages. Written by arduino/generate_protocol.py from protocol.toml; do not edit."""',
        "",
        "from __future__ import annotations",
        "",
        "from enum import IntEnum, IntFlag",
        "from typing import NamedTuple",
        "",
        f"VERSION = {definition['version']}",
        f"HASH = 0x{protocol_hash(definition):04X}",
        f'STOP_BYTE = b"\\x{definition["stop_byte"]:02x}"',
        f"MAX_LINE = {definition['max_line']}",
        "",
        "",
        "class FieldSpec(NamedTuple):",
        "    name: str",
        "    length: int",
        "    minimum: int",
        "    maximum: int",
        "",
    ]
    for enum, members in definition["enum"].items():
        base = "IntFlag" if enum.endswith("_flag") else "IntEnum"
        title = "".join(part.capitalize() for part in enum.split("_"))
        lines += ["", f"class {title}({base}):"]
        lines += [f"    {member} = {value}" for member, value in members.items()]
        lines.append("")
    for message in definition["message"]:
        lines += ["", f"class {_name(message)}(NamedTuple):"]
        lines += [f'    """{message["sender"]} -> {message["receiver"]}, {message["rate"]}."""', ""]
        for field in message["fields"]:
            note = ", ".join(field[key] for key in ("unit", "note") if key in field)
            hint = "tuple[int, ...]" if "count" in field else "int"
            comment = f"  # {note}" if note and len(note) < 90 else ""
            lines.append(f"    {field['name']}: {hint}{comment}")
        if message["fields"]:
            lines.append("")
    lines += ["", "Message = " + " | ".join(_name(m) for m in definition["message"])]
    lines += ["", "# (sender, receiver, type) and fields of each message"]
    lines.append("LAYOUT: dict[type[Message], tuple[str, str, str, tuple[FieldSpec, ...]]] = {")
    for message in definition["message"]:
        lines.append(f"    {_name(message)}: (")
        lines += [f'        "{message[key]}",' for key in ("sender", "receiver", "type")]
        specs = [f'FieldSpec("{f["name"]}", {f.get("count", 1)}, {f["min"]}, {f["max"]}),' for f in message["fields"]]
        if len(specs) > 1:
            lines += ["        (", *(f"            {spec}" for spec in specs), "        ),"]
        else:
            lines.append(f"        ({''.join(specs)}),")
        lines.append("    ),")
    lines += ["}", "", "# `Ack.of` of the messages to the board"]
    lines.append("NUMBER: dict[type[Message], int] = {")
    lines += [f"    {_name(m)}: {m['number']}," for m in definition["message"] if "number" in m]
    lines += ["}", ""]
    return "\n".join(lines)


def main() -> int:
    definition = tomllib.loads(DEFINITION.read_text(encoding="utf-8"))
    HEADER.write_text(c_header(definition), encoding="utf-8")
    MODULE.write_text(python_module(definition), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
