"""`pinflex verify` itself: every benchmark within its limit, and failures shown as failures."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.__main__ import main
from pinflex.lab import verify
from pinflex.lab.scene import Case, Check, Outcome
from pinflex.lab.verify import CASES

# Each as the command runs it by default, about two minutes in all; `--long` has the others.
NAMES = [case.name for case in CASES if not case.slow]


@pytest.mark.parametrize("name", NAMES)
def test_every_benchmark_is_within_its_limits(name: str) -> None:
    found = verify.verify([name])
    assert found.records
    far = [f"{r.quantity}: {r.measured} for {r.reference}" for r in found.records
           if not r.passed and not r.reported]  # fmt: skip
    assert not far


def test_a_check_measures_relative_or_absolute_distance_and_never_passes_nan() -> None:
    assert Check("", 1.01, 1.0, 0.02).error == pytest.approx(0.01)
    assert Check("", 0.01, 0.0, 0.02, False).passed
    assert not Check("", 1.03, 1.0, 0.02).passed
    assert not Check("", float("nan"), 1.0, 1e9).passed


def test_a_case_that_raises_is_a_failed_record_and_the_others_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken() -> Outcome:
        raise pf.ConvergenceError("t = 1 s: it stopped")

    good = Case("good", "here", lambda: Outcome((Check("one", 1.0, 1.0, 0.0),)))
    monkeypatch.setattr(verify, "CASES", (Case("bad", "nowhere", broken), good))
    found = verify.verify()
    assert [r.passed for r in found.records] == [False, True]
    assert not found.passed
    assert np.isnan(found.records[0].measured)
    assert "it stopped" in verify.case_text("bad", found.records[:1])
    assert "1 of 2 quantities" in verify.verdict(found)


def test_a_reported_row_is_shown_and_never_counts_as_passed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows = (Check("near", 1.0, 1.0, 0.1), Check("far", 2.0, 1.0, 0.1, note="why", reported=True),
            Check("lucky", 1.0, 1.0, 0.1, reported=True))  # fmt: skip
    monkeypatch.setattr(verify, "CASES", (Case("one", "here", lambda: Outcome(rows)),))
    found = verify.verify()
    assert [r.mark for r in found.records] == ["ok", "off", "off"]
    assert found.passed
    assert "1 of 3 quantities passed" in verify.verdict(found)
    assert "the other 2 are known to be outside their limits" in verify.verdict(found)
    assert "far: why" in verify.case_text("one", found.records)


def test_slow_cases_run_only_when_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def one(name: str, slow: bool) -> Case:
        return Case(name, "here", lambda: Outcome((Check(name, 1.0, 1.0, 0.0),)), slow)

    monkeypatch.setattr(verify, "CASES", (one("quick", False), one("patient", True)))
    assert [r.case for r in verify.verify().records] == ["quick"]
    assert [r.case for r in verify.verify(slow=True).records] == ["quick", "patient"]
    assert [r.case for r in verify.verify(["patient"]).records] == ["patient"]


def test_an_unknown_case_is_named_with_the_nearest() -> None:
    with pytest.raises(pf.DescriptionError, match=r"verify: A99.*Allowed: .*A01"):
        verify.verify(["A99"])


def test_the_command_prints_json_and_writes_a_page_with_a_plot(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "verify.html"
    assert main(["verify", "A04", "--json", "-o", str(page)]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["passed"] is True
    assert {r["case"] for r in printed["records"]} == {"A04 Bricard mechanism"}
    text = page.read_text(encoding="utf-8")
    assert "data:image/png;base64," in text
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert main(["verify", "A04"]) == 0
    assert "all within their limits" in capsys.readouterr().out
