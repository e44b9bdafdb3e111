"""Every message of an export is valid by its own schema and by the one that Foxglove publishes."""

from __future__ import annotations

import importlib
import io
import json
import math
from collections import defaultdict
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from google.protobuf import json_format
from google.protobuf.descriptor import Descriptor
from mcap.reader import make_reader
from mcap.records import Schema

from fleet.analysis.palette import rgb_of
from fleet.config.loading import convert, read_scenario
from fleet.config.scenario import Scenario
from fleet.export.foxglove import write_foxglove
from fleet.export.foxglove_shapes import towards
from fleet.export.lines import lines_of
from fleet.export.scene import scene_of
from tests.conftest import fly

SETTINGS = (
    "tick_s=0.5",
    "surveillance.broadcast_s=0.5",
    "coordination.update_s=0.5",
    "coordination.heartbeat_s=0.5",
    "zone.radius_m=150",
    "zone.half_height_m=30",
    "duration_s=75",
)
Said = list[tuple[Schema, int, dict[str, Any]]]


def exported(*settings: str) -> tuple[Scenario, dict[str, Said]]:
    """A run, and its export by topic: schema, time in ns and content of each message."""
    scenario = read_scenario("head_on", [*SETTINGS, *settings]).scenario
    kept = fly("head_on", *SETTINGS, *settings).kept
    scene = scene_of(scenario, kept)
    file, topics = io.BytesIO(), defaultdict[str, Said](list)
    count = write_foxglove(file, scene, lines_of(kept, (), scene))
    last_ns = 0
    file.seek(0)
    for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
        assert schema is not None
        assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
        assert last_ns <= message.log_time == message.publish_time
        last_ns = message.log_time
        topics[channel.topic].append((schema, message.log_time, json.loads(message.data)))
    assert sum(map(len, topics.values())) == count
    return scenario, topics


@pytest.fixture(scope="module")
def export() -> tuple[Scenario, dict[str, Said]]:
    """Two UAVs that avoid each other."""
    return exported()


@pytest.fixture(scope="module")
def topics(export: tuple[Scenario, dict[str, Said]]) -> dict[str, Said]:
    """What was exported."""
    return export[1]


def published(name: str) -> type:
    """The class that Foxglove publishes for a schema, from its definition for protobuf."""
    cls = name.removeprefix("foxglove.")
    found: type = getattr(importlib.import_module(f"foxglove_schemas_protobuf.{cls}_pb2"), cls)
    return found


def as_protobuf(value: Any, descriptor: Descriptor | None) -> Any:
    """JSON as Foxglove writes it, in protobuf's notation; every published field must be there."""
    assert descriptor is not None
    if descriptor.full_name in ("google.protobuf.Timestamp", "google.protobuf.Duration"):
        assert value.keys() == {"sec", "nsec"}
        if descriptor.name == "Duration":
            return f"{value['sec']}.{value['nsec']:09}s"
        minutes, seconds = divmod(value["sec"], 60)
        return f"1970-01-01T00:{minutes:02}:{seconds:02}.{value['nsec']:09}Z"
    assert value.keys() == {field.name for field in descriptor.fields}
    out = {}
    for field in descriptor.fields:
        own = value[field.name]
        if field.message_type:
            many = isinstance(own, list)
            parts = [as_protobuf(part, field.message_type) for part in (own if many else [own])]
            own = parts if many else parts[0]
        out[field.name] = own
    return out


def test_every_message_is_valid_by_the_schema_in_the_file(topics: dict[str, Said]) -> None:
    validators: dict[str, jsonschema.Draft202012Validator] = {}
    for said in topics.values():
        for schema, _, content in said:
            if schema.name not in validators:
                parsed = json.loads(schema.data)
                jsonschema.Draft202012Validator.check_schema(parsed)
                assert parsed["type"] == "object"
                assert parsed["title"] == schema.name
                validators[schema.name] = jsonschema.Draft202012Validator(parsed)
            validators[schema.name].validate(content)


def test_every_message_is_one_that_foxglove_publishes(topics: dict[str, Said]) -> None:
    checked = set()
    for said in topics.values():
        for schema, _, content in said:
            if schema.name.startswith("foxglove."):
                cls: Any = published(schema.name)
                json_format.ParseDict(as_protobuf(content, cls.DESCRIPTOR), cls())
                checked.add(schema.name.removeprefix("foxglove."))
    assert checked == {"SceneUpdate", "FrameTransforms", "PosesInFrame", "LocationFix", "Log"}


def test_schemas_use_only_what_viewers_understand(topics: dict[str, Said]) -> None:
    def look(node: dict[str, Any]) -> None:
        assert node["type"] in ("object", "array", "string", "number", "integer", "boolean")
        for below in node.get("properties", {}).values():
            look(below)
        if node["type"] == "array":
            look(node["items"])

    for said in topics.values():
        look(json.loads(said[0][0].data))


def test_the_topics_are_those_of_the_documents(topics: dict[str, Said]) -> None:
    told = (Path(__file__).parents[2] / "docs" / "viewers.md").read_text(encoding="utf-8")
    shared = {"/routes", "/tf", "/poses", "/zones", "/commands", "/trails", "/log"}
    own = {f"/uav/{n}/{what}" for n in (1, 2) for what in ("fix", "state")}
    assert topics.keys() == shared | own | {"/separation/1-2", "/separation/least"}
    for topic in [*shared, "/uav/N/fix", "/uav/N/state", "/separation/A-B", "/separation/least"]:
        assert f"| `{topic}` |" in told


def test_zones_have_the_size_of_the_scenario_and_the_colour_of_their_uav(
    export: tuple[Scenario, dict[str, Said]],
) -> None:
    _, _, first = export[1]["/zones"][0]
    for index, entity in enumerate(first["entities"]):
        assert entity["frame_id"] == f"uav/{index + 1}"
        (cylinder,) = entity["cylinders"]
        assert cylinder["size"] == {"x": 300.0, "y": 300.0, "z": 60.0}
        colour = [round(255 * cylinder["color"][part]) for part in "rgb"]
        assert tuple(colour) == rgb_of(index)


def test_frames_and_poses_are_where_the_uavs_are(topics: dict[str, Said]) -> None:
    for (_, at, frames), (_, posed_at, poses) in zip(topics["/tf"], topics["/poses"], strict=True):
        assert at == posed_at
        places = [frame["translation"] for frame in frames["transforms"]]
        assert places == [pose["position"] for pose in poses["poses"]]
    first = topics["/tf"][0][2]["transforms"][0]
    assert (first["parent_frame_id"], first["child_frame_id"]) == ("enu", "uav/1")
    assert first["translation"] == {"x": -2000.0, "y": 0.0, "z": 300.0}


@pytest.mark.parametrize("intent", [(1, 0, 0), (0, -2, 0), (-1, 1, 0.5), (3, -4, -2), (0, 0, 1)])
def test_an_orientation_turns_x_to_where_it_points(intent: tuple[float, ...]) -> None:
    q = towards(np.array(intent, float))
    turned = [
        1 - 2 * (q.y**2 + q.z**2),
        2 * (q.x * q.y + q.z * q.w),
        2 * (q.x * q.z - q.y * q.w),
    ]
    assert turned == pytest.approx(np.array(intent) / np.linalg.norm(intent), abs=1e-12)
    assert 2 * (q.y * q.z + q.x * q.w) == pytest.approx(0.0, abs=1e-12)  # y stays level
    assert math.hypot(q.x, q.y, q.z, q.w) == pytest.approx(1.0)


def test_each_update_shows_everything_of_its_topic(topics: dict[str, Said]) -> None:
    for topic in ("/routes", "/zones", "/commands", "/trails"):
        for _, _, content in topics[topic]:
            assert [d["type"] for d in content["deletions"]] == [1]  # all
    for _, _, content in [*topics["/zones"], *topics["/trails"]]:
        assert len(content["entities"]) == 2


def test_arrows_are_there_while_commands_are_flown(topics: dict[str, Said]) -> None:
    shown = [len(content["entities"]) for _, _, content in topics["/commands"]]
    assert shown[0] == 0
    assert max(shown) >= 1
    (arrow,) = next(c for _, _, c in topics["/commands"] if c["entities"])["entities"][0]["arrows"]
    assert arrow["shaft_length"] + arrow["head_length"] == pytest.approx(12.0 * 25.0, rel=0.1)
    labels = {e["texts"][0]["text"] for _, _, c in topics["/zones"] for e in c["entities"]}
    assert {"1", "2"} < labels


def test_a_zone_is_brighter_while_another_overlaps_it() -> None:
    _, topics = exported("resolver=none", "duration_s=90")
    opacities = {
        entity["metadata"][1]["value"]: entity["cylinders"][0]["color"]["a"]
        for _, _, content in topics["/zones"]
        for entity in content["entities"]
    }
    assert opacities["true"] > opacities["false"]
    assert any(content["level"] == 4 for _, _, content in topics["/log"])


def test_trails_end_at_the_uav_and_are_a_minute_long(topics: dict[str, Said]) -> None:
    _, at, content = topics["/trails"][-2]
    points = content["entities"][0]["lines"][0]["points"]
    poses = next(c for _, t_ns, c in topics["/poses"] if t_ns == at)
    assert points[-1] == poses["poses"][0]["position"]
    assert len(points) == 60


def test_fixes_are_near_the_origin(topics: dict[str, Said]) -> None:
    _, _, fix = topics["/uav/1/fix"][0]
    assert fix["altitude"] == pytest.approx(488.0 + 300.0, abs=0.5)
    assert fix["latitude"] == pytest.approx(47.3977, abs=1e-3)
    assert fix["longitude"] == pytest.approx(8.545594 - 2000.0 / 75_500.0, abs=1e-3)
    assert fix["heading"] == pytest.approx(math.pi / 2)


def test_a_uav_that_vanishes_is_shown_no_more() -> None:
    base = read_scenario("head_on", SETTINGS).scenario
    kept = [m for m in fly("head_on", *SETTINGS).kept if m.id != 2 or m.t_ns < 30e9]
    scene = scene_of(convert({"name": "x", "duration_s": 75, "uav": _uavs(base)}, "x"), kept)
    file = io.BytesIO()
    write_foxglove(file, scene, [])
    file.seek(0)
    said = defaultdict[str, list[dict[str, Any]]](list)
    for _, channel, message in make_reader(file).iter_messages():
        said[channel.topic].append(json.loads(message.data))
    zones, trails = said["/zones"], said["/trails"]
    assert len(zones[0]["entities"]) == 2
    assert [entity["id"] for entity in zones[-1]["entities"]] == ["zone/1"]
    lengths = [len(e["lines"][0]["points"]) for e in trails[-1]["entities"]]
    assert lengths == [60, 15]  # of the minute before 75 s the second was there until 30 s


def _uavs(scenario: Scenario) -> list[dict[str, Any]]:
    return [
        {
            "id": uav.id,
            "position_ned_m": uav.position_ned_m,
            "heading_deg": uav.heading_deg,
            "waypoints_ned_m": uav.waypoints_ned_m,
        }
        for uav in scenario.uav
    ]
