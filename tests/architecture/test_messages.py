"""The message table says what the specification asks for."""

from __future__ import annotations

import dataclasses
from typing import get_type_hints

import pytest

from common.errors import ERRORS, ErrorCode
from common.field_checks import field_of
from common.messages.topics import INTERNAL_FLOWS, STATUS, TOPICS
from common.modules import MODULES

FLOWS = {
    f"lfc_{name}"
    for name in (
        *("poi_cm", "mmu_poi", "poi_pln", "pln_car", "mmu_pln", "mmu_cm"),
        *("sim_pln", "sim_mmu", "sim_car", "cm_vsl", "vsl_cc", "cm_cc"),
    )
}


def test_all_flows_of_the_specification_are_there_and_no_other() -> None:
    on_the_bus = {flow for topic in TOPICS for flow in topic.flows}
    assert on_the_bus | set(INTERNAL_FLOWS) == FLOWS


def test_every_key_is_a_module_and_a_variable() -> None:
    keys = [topic.key for topic in TOPICS]
    assert len(set(keys)) == len(keys)
    assert all(key.count("/") == 1 for key in keys)


def test_every_payload_says_when_and_whether_it_is_valid() -> None:
    for payload in {topic.payload for topic in TOPICS}:
        fields = {field.name: field for field in dataclasses.fields(payload)}  # type: ignore[arg-type]
        assert get_type_hints(payload)["t_s"] is float, payload
        assert fields["valid"].default is True, payload


@pytest.mark.parametrize("payload", sorted({topic.payload for topic in TOPICS}, key=str))
def test_every_field_says_its_bounds(payload: type) -> None:
    hints = get_type_hints(payload, include_extras=True)
    for field in dataclasses.fields(payload):  # type: ignore[arg-type]
        field_of(field.name, hints[field.name])


@pytest.mark.requirement("CC_MR_03")
def test_every_module_reports_its_status_ten_times_a_second() -> None:
    assert {module.name for module in MODULES} == set(STATUS)
    for topic in STATUS.values():
        assert topic.rate_hz == 10.0
        assert "command_center" in topic.consumers
        assert {"state", "error_code", "memory_kb"} <= set(get_type_hints(topic.payload))


def test_every_error_code_has_a_meaning_and_an_action() -> None:
    assert set(ERRORS) == set(ErrorCode)
    assert all(info.meaning and info.action for info in ERRORS.values())
