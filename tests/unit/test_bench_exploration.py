"""The lines that `bench exploration` prints."""

from __future__ import annotations

from deploy.bench.exploration import COLUMNS, HEAD, line, totals


def test_figures_stand_below_their_names_and_what_a_run_lacks_is_a_dash() -> None:
    text = line("hall 0", {"halls": 1.0, "path_m": 73.25, "outcome": "finished"})
    for name, shown in (("halls", "1.000"), ("path_m", "73.250"), ("tour_ratio", "-")):
        end = HEAD.index(name) + len(name)
        assert text[:end].endswith(shown)
    assert text.endswith("finished")


def test_totals_count_the_runs_that_have_the_figure() -> None:
    runs = [{"tour_ratio": 1.0, "finished": True}, {"tour_ratio": 1.5, "finished": True}, {"finished": False}]
    mean, least, most, finished = totals(runs)
    column = slice(26 + 11 * COLUMNS.index("tour_ratio"), 26 + 11 * (COLUMNS.index("tour_ratio") + 1))
    assert [text[column].strip() for text in (mean, least, most)] == ["1.250", "1.000", "1.500"]
    assert finished == "finished: 2 of 3"
