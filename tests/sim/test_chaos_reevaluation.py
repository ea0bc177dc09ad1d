"""What robots evaluate again is what they would evaluate from scratch, at every plan of chaos."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.bt.evaluation import Evaluation, EvaluationFacts
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.incremental.evaluation.evaluator import IncrementalEvaluator
from mrbt_mesh.sim.chaos.campaign import run_seed
from tests.support.runs import source

SEEDS, BLOCK = 24, 4


@pytest.fixture
def compared(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Evaluations that are held against one from scratch: 1 for each that was another one."""
    results: list[int] = []
    last: dict[IncrementalEvaluator, Evaluation] = {}
    evaluate = IncrementalEvaluator.evaluate

    def checked(self: IncrementalEvaluator, facts: EvaluationFacts) -> Evaluation:
        found = evaluate(self, facts)
        assert found == Evaluator(self.tree).evaluate(facts)
        results.append(found != last.get(self))
        last[self] = found
        return found

    monkeypatch.setattr(IncrementalEvaluator, "evaluate", checked)
    return results


@pytest.mark.parametrize("first", range(0, SEEDS, BLOCK))
def test_in_generated_missions(first: int, compared: list[int]) -> None:
    for seed in range(first, first + BLOCK):
        _run(None, seed)
    assert sum(compared) > 10 * BLOCK


@pytest.mark.parametrize("name", ["vehicle_repair", "explore"])
def test_in_examples(name: str, compared: list[int]) -> None:
    _run(name, 1)
    assert sum(compared) > 5


def _run(name: str | None, seed: int) -> None:
    try:
        verdict = run_seed(source(name), seed)
    except AssertionError as error:
        raise AssertionError(f"{name or 'generated'}, seed {seed}") from error
    assert not verdict.violations, f"{name or 'generated'}, seed {seed}: {verdict.violations}"
