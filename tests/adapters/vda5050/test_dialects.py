"""Messages in every version, against schemas that others have published: those of npm's
vda-5050-lib (1.1, 2.0) and of PyPI's vda5050-sdk (2.1). `make test-vda5050` gets both.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
from pathlib import Path
from typing import Any

import fastjsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.vda5050.dialects import (
    DIALECTS,
    Action,
    OrderNode,
    VehicleAddress,
    VehicleOrder,
    cancel_order,
    instant_message,
    order_message,
    state_request,
    timestamp,
)
from tests.support.vda5050.plant import LIBRARY_VARIABLE, lacking

ACTIONS = st.builds(
    Action,
    st.text("abc/1", min_size=1, max_size=8),
    st.sampled_from(["pick", "drop", "noop"]),
    st.dictionaries(
        st.text(min_size=1, max_size=4),
        st.text()
        | st.booleans()
        | st.integers()
        | st.floats(allow_nan=False, allow_infinity=False),
        max_size=3,
    ),
    st.sampled_from(["NONE", "SOFT", "HARD"]),
)
METRES = st.floats(-1e6, 1e6)
NODES = st.builds(
    OrderNode,
    st.text(min_size=1, max_size=8),
    METRES,
    METRES,
    st.none() | st.floats(-10, 10),
    st.floats(0, 100),
    st.lists(ACTIONS, max_size=3).map(tuple),
)


@st.composite
def orders(draw: Any) -> VehicleOrder:
    nodes = tuple(draw(st.lists(NODES, min_size=1, max_size=5)))
    limit = st.none() | st.floats(0.1, 5)
    limits = tuple(draw(limit) for _ in nodes[1:])
    return VehicleOrder(draw(st.text(min_size=1, max_size=8)), "hall", nodes, limits)


def address(name: str) -> VehicleAddress:
    return VehicleAddress("uagv", "Acme", "F1", DIALECTS[name])


def headed(name: str, body: dict[str, Any]) -> dict[str, Any]:
    return address(name).headed(0, 1_700_000_000.5, body)


@pytest.mark.parametrize(
    ("name", "topic"),
    [
        ("1.1", "uagv/v1/Acme/F1/order"),
        ("2.0", "uagv/v2/Acme/F1/order"),
        ("2.1", "uagv/v2/Acme/F1/order"),
        ("3.0", "uagv/v3/Acme/F1/order"),
    ],
)
def test_topics_and_headers(name: str, topic: str) -> None:
    assert address(name).topic("order") == topic
    header = headed(name, {})
    assert header["version"] == f"{name}.0"
    assert header["timestamp"] == "2023-11-14T22:13:20.500Z"
    assert timestamp(0.0) == "1970-01-01T00:00:00.000Z"


def test_what_differs_between_the_versions() -> None:
    nodes = (OrderNode("A", 0, 0, deviation_m=1.5), OrderNode("B", 1, 0, theta=7.0))
    order = VehicleOrder("o1", "hall", nodes, (0.5,))
    old, new = (order_message(order, DIALECTS[name]) for name in ("2.0", "3.0"))
    assert old["nodes"][0]["nodePosition"]["allowedDeviationXy"] == 1.5
    assert new["nodes"][0]["nodePosition"]["allowedDeviationXY"] == {
        "a": 1.5,
        "b": 1.5,
        "theta": 0.0,
    }
    assert (old["edges"][0]["startNodeId"], old["edges"][0]["maxSpeed"]) == ("A", 0.5)
    assert "startNodeId" not in new["edges"][0]
    assert new["edges"][0]["maximumSpeed"] == 0.5
    assert old["nodes"][1]["nodePosition"]["theta"] == pytest.approx(7.0 - 6.283185307)
    keys = {name: set(instant_message([cancel_order("c")], DIALECTS[name])) for name in DIALECTS}
    assert keys == {
        "1.1": {"instantActions"},
        "2.0": {"actions", "instantActions"},
        "2.1": {"actions"},
        "3.0": {"actions"},
    }


@given(orders(), st.sampled_from(sorted(DIALECTS)))
def test_orders_are_one_chain_that_is_released(order: VehicleOrder, name: str) -> None:
    message = json.loads(json.dumps(order_message(order, DIALECTS[name])))
    chain = sorted([*message["nodes"], *message["edges"]], key=lambda part: part["sequenceId"])
    assert [part["sequenceId"] for part in chain] == list(range(len(chain)))
    assert ["nodeId" in part for part in chain] == [n % 2 == 0 for n in range(len(chain))]
    assert all(part["released"] for part in chain)
    assert chain[-1]["sequenceId"] == order.last_sequence_id


SCHEMAS = importlib.util.find_spec("vda5050")
VALIDATE = """
const lines = require("fs").readFileSync(0, "utf8").split("\\n").filter(Boolean).map(JSON.parse);
for (const [version, name, message] of lines) {
  const lib = require(`vda-5050-lib/common/vda-5050-validators-${version}.js`);
  if (!lib[name](message)) console.log(JSON.stringify([version, name, lib[name].errors]));
}
"""


@pytest.mark.skipif(bool(lacking()), reason=lacking())
@pytest.mark.parametrize("name", ["1.1", "2.0"])
def test_messages_are_valid_by_the_schemas_of_npms_library(name: str) -> None:
    lines: list[Any] = []

    @given(orders(), ACTIONS)
    def collect(order: VehicleOrder, action: Action) -> None:
        dialect = DIALECTS[name]
        lines.append([name, "validateOrder", headed(name, order_message(order, dialect))])
        instant = instant_message([cancel_order("c"), state_request("s"), action], dialect)
        lines.append([name, "validateInstantActions", headed(name, instant)])

    collect()
    wrong = [name, "validateOrder", {**lines[0][2], "orderId": 1}]
    modules = Path(os.environ[LIBRARY_VARIABLE]) / "node_modules"
    done = subprocess.run(
        ["node", "-e", VALIDATE],
        input="\n".join(json.dumps(line) for line in [*lines, wrong]),
        env=os.environ | {"NODE_PATH": str(modules)},
        capture_output=True,
        text=True,
        check=True,
    )
    (refused,) = done.stdout.splitlines()
    assert "orderId" in refused


@pytest.mark.skipif(SCHEMAS is None, reason="vda5050-sdk is not installed: make test-vda5050")
@given(order=orders(), action=ACTIONS)
def test_messages_are_valid_by_the_schemas_of_pypis_sdk(
    order: VehicleOrder, action: Action
) -> None:
    dialect = DIALECTS["2.1"]
    _validator("order")(headed("2.1", order_message(order, dialect)))
    instant = instant_message([cancel_order("c"), action], dialect)
    _validator("instantActions")(headed("2.1", instant))
    with pytest.raises(fastjsonschema.JsonSchemaException, match="orderId"):
        _validator("order")(headed("2.1", order_message(order, dialect) | {"orderId": 1}))


def _validator(name: str) -> Any:
    assert SCHEMAS is not None
    if name not in _VALIDATORS:
        assert SCHEMAS.origin is not None
        file = Path(SCHEMAS.origin).parent / "validation/schemas" / f"{name}.json"
        schema = json.loads(file.read_text())
        schema.pop("$schema", None)
        _VALIDATORS[name] = fastjsonschema.compile(schema)
    return _VALIDATORS[name]


_VALIDATORS: dict[str, Any] = {}
