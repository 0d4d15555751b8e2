"""Any URDF becomes a Model with finite results, or raises a SpatialDynError.

A sound robot is drawn as a tree of elements; elements and attributes are dropped, doubled, renamed, moved and given
other values; then the text itself is cut, recoded and spoilt.
"""

from __future__ import annotations

import copy
import warnings
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fuzzing import cases
from hypothesis import given
from hypothesis import strategies as st
from slow import slow_but

import spatialdyn as sd
from spatialdyn.commands.cli import main

LARGE, LONG = "9" * 400, "x" * 3000
NUMBERS = ("0", "1", "-1", "0.5", "1e-3", "1e-9", "1e3", "1.57079632679", "3.14159")
ODD_NUMBERS = (
    "nan", "-nan", "inf", "-inf", "Infinity", "1e400", "-1e400", "1e308", "-1e308", "1e154", "1e-400", "5e-324", "-0",
    LARGE, "0." + LARGE, "1" + "0" * 308,
)  # fmt: skip
WORDS = (
    "", " ", "\t\n", "word", "1,2,3", "1 2", "1 2 3 4", "0x10", "1_000", "1.0f", "+-1", "1e", ".", "--", "1e5.5",
    "None",
    "\u0663", "\uff11", "1\u00a02\u00a03", "\u202e", "${pi}", "$(arg x)", "../../etc/passwd", "&amp;", "<link/>", "]]>",
    "a\x00b", "a\x1bb", "\x85", "\ud800", "\U0001f916", "gelenk ä", "日本", LONG, LONG[:300],
    LONG[:300] + ".urdf", "/" + LONG[:300], "/" + LONG[:300] + "/a.urdf", "a\x00b.urdf", "/proc/self/mem", ".", "/",
    "~", "*", "link:b0", "joint:j1", "universe", "b0", "j1",
)  # fmt: skip
TRIPLES = ("0 0 0", "1 0 0", "0 0 -1", "1 2 3", "1e-300 0 0", "1e300 1e300 1e300", "5e-324 0 0", "nan 0 0", "inf 0 0")
KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
ODD_KINDS = ("spherical", "Revolute", "ball", "")
TAGS = (
    "robot", "link", "joint", "inertial", "mass", "inertia", "origin", "parent", "child", "axis", "limit", "dynamics",
    "mimic", "visual", "collision", "transmission", "gazebo", "LINK", "a:link", "calibration", "xi:include",
)  # fmt: skip
KEYS = (
    "name", "type", "value", "xyz", "rpy", "link", "joint", "ixx", "ixy", "izz", "lower", "upper", "effort", "velocity",
    "damping", "multiplier", "offset", "xmlns", "xml:base", "NAME", "version",
)  # fmt: skip
HEADS = (
    "<?xml version='1.0'?>", "<?xml version='1.0' encoding='utf-8'?>", "<?xml version='1.0' encoding='latin-1'?>",
    "<?xml version='1.0' encoding='utf-16'?>", "<?xml version='1.0' encoding='klingon'?>", "<?xml version='1.1'?>",
    "<!DOCTYPE robot>", "<!DOCTYPE robot [<!ENTITY a 'b'>]>", "<!doctype robot>", "<?a b?>", "<!-- c -->", "\ufeff",
    "\n\n",
    "<!DOCTYPE robot SYSTEM 'file:///etc/passwd'>", "<![CDATA[", "x", "<a/>", "<!--", "<?xml?>",
    "<!-- <!DOCTYPE robot> -->",
)  # fmt: skip
CODECS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32", "latin-1", "cp037", "utf-7")
SPOILS = (
    "<",
    ">",
    "&",
    "&lol;",
    "&#0;",
    "&#x110000;",
    "\0",
    '"',
    "'",
    "</robot>",
    "<robot>",
    "<!--",
    "]]>",
    "<?",
    "<x>" * 600,
)

values = st.sampled_from(NUMBERS + ODD_NUMBERS + WORDS + TRIPLES + KINDS + ODD_KINDS)
place = st.integers(0, 999)  # of an element or attribute, counted round and round
changes = ["value"] * 3 + [
    "drop", "double", "move", "tag", "key", "lose", "refer", "rename", "weigh", "text", "nest", "comment",
]  # fmt: skip
mutations = st.lists(
    st.tuples(st.sampled_from(changes), place, place, values, st.sampled_from(TAGS), st.sampled_from(KEYS)), max_size=4
)
spoils = st.lists(
    st.tuples(
        st.sampled_from(["cut", "head", "insert", "erase"]), place, st.sampled_from(HEADS), st.sampled_from(SPOILS)
    ),
    max_size=2,
)
options = st.fixed_dictionaries(
    {},
    optional={
        "root": st.sampled_from(["fixed", "floating", "other"]),
        "continuous": st.sampled_from(["angle", "cos_sin"]),
        "mimic": st.booleans(),
        "inertia": st.sampled_from(["warn", "strict", "repair"]),
        "snap": st.sampled_from([None, 0.0, 1e-9, 0.1, -1.0, float("nan")]),
    },
)


@st.composite
def robots(draw: Any) -> ET.Element:
    """A sound robot of up to seven links."""
    number = st.sampled_from(NUMBERS)
    positive = st.sampled_from(("1", "0.5", "1e-3", "1e3", "1e-9"))
    weight = st.sampled_from(("1", "0.5", "1e-3", "1e3", "1e-9", "0"))
    root = ET.Element("robot", name="r")
    count = draw(st.integers(1, 7))

    def triple() -> str:
        return " ".join(draw(st.tuples(number, number, number)))

    for k in range(count):
        link = ET.SubElement(root, "link", name=f"b{k}")
        if draw(st.integers(0, 4)):
            inertial = ET.SubElement(link, "inertial")
            if draw(st.booleans()):
                ET.SubElement(inertial, "origin", xyz=triple(), rpy=triple())
            ET.SubElement(inertial, "mass", value=draw(weight))
            moment = draw(positive)
            ET.SubElement(
                inertial, "inertia", ixx=moment, iyy=moment, izz=draw(positive), ixy="0", ixz=draw(number), iyz="0"
            )
        if not k:
            continue
        joint = ET.SubElement(root, "joint", name=f"j{k}", type=draw(st.sampled_from(KINDS)))
        ET.SubElement(joint, "parent", link=f"b{draw(st.integers(0, k - 1))}")
        ET.SubElement(joint, "child", link=f"b{k}")
        extras = draw(st.integers(0, 31))
        if extras & 1:
            ET.SubElement(joint, "origin", xyz=triple(), rpy=triple())
        if extras & 2:
            ET.SubElement(joint, "axis", xyz=draw(st.sampled_from(("0 0 1", "0 1 0", "-1 0 0", "1 2 3"))))
        if extras & 4:
            ET.SubElement(joint, "limit", lower="-1", upper=draw(positive), effort="1", velocity="1")
        if extras & 8:
            ET.SubElement(joint, "dynamics", damping=draw(positive))
        if extras & 16 and k > 1:
            ET.SubElement(joint, "mimic", joint=f"j{draw(st.integers(1, k - 1))}", multiplier=draw(number))
    return root


def mutated(root: ET.Element, changes: list[Any]) -> ET.Element:
    """The tree after some changes."""
    root = copy.deepcopy(root)
    for what, at, where, value, tag, key in changes:
        elements = list(root.iter())
        parents = {child: parent for parent in elements for child in parent}
        element = elements[at % len(elements)]
        parent, other = parents.get(element), elements[where % len(elements)]
        keys = sorted(element.attrib)
        if what in ("value", "key", "lose") and not keys:
            carriers = [e for e in elements if e.attrib]
            element = carriers[at % len(carriers)] if carriers else element
            keys = sorted(element.attrib)
        if what == "value":
            element.set(keys[where % len(keys)] if keys else key, value)
        elif what == "key":
            element.set(key, element.attrib.pop(keys[where % len(keys)]) if keys else value)
        elif what == "lose" and keys:
            del element.attrib[keys[where % len(keys)]]
        elif what == "refer":
            ends = [e for e in elements if e.tag in ("parent", "child", "mimic")]
            names = [e.get("name", "") for e in elements if e.tag in ("link", "joint")]
            if ends and names:
                end = ends[at % len(ends)]
                end.set("joint" if end.tag == "mimic" else "link", names[where % len(names)])
        elif what == "rename":  # two links, two joints, or one of each, of one name
            named = [e for e in elements if e.tag in ("link", "joint")]
            if named:
                named[at % len(named)].set("name", named[where % len(named)].get("name", ""))
        elif what == "weigh":
            masses = [e for e in elements if e.tag == "mass"]
            if masses:
                masses[at % len(masses)].set("value", "0")
        elif what == "tag":
            element.tag = tag
        elif what == "text":
            element.text = element.tail = value
        elif what == "comment":
            element.insert(0, ET.Comment(value))
        elif what == "nest":
            for _ in range(where % 200):  # four such fit the stack of deepcopy and tostring; "<x>" * 600 is deeper
                element = ET.SubElement(element, tag)
        elif parent is not None and what == "drop":
            parent.remove(element)
        elif parent is not None and what == "double":
            parent.append(copy.deepcopy(element))
        elif parent is not None and what == "move" and element not in other.iter() and other not in element.iter():
            parent.remove(element)
            other.append(element)
    return root


def spoilt(text: str, changes: list[Any], codec: str, binary: bool) -> str | bytes:
    """The text after some accidents, as text or in an encoding."""
    for what, at, head, part in changes:
        here = len(text) * at // 1000
        if what == "cut":
            text = text[:here]
        elif what == "head":
            text = head + text
        elif what == "insert":
            text = text[:here] + part + text[here:]
        else:
            text = text[:here] + text[here + at % 40 :]
    return text.encode(codec, errors="replace") if binary else text


def loaded(source: Any, chosen: dict[str, Any]) -> sd.Model | None:
    """The model, if it is not refused; of warnings only the one about inertias may come."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message='robot "', category=UserWarning)
        try:
            return sd.load_urdf(source, **chosen)
        except sd.SpatialDynError as error:
            assert len(str(error)) > 20  # noqa: PT017 - a refusal says something
            return None


def answers(model: sd.Model, seed: int) -> None:
    """Each call is finite or raises a SpatialDynError."""
    rng = np.random.default_rng(seed)
    q = sd.random_configuration(model, rng)
    v, x = rng.normal(size=(2, model.nv))
    assert np.isfinite(q).all()
    for name, given_ in (("rnea", (q, v, x)), ("crba", (q,)), ("aba", (q, v, x)), ("forward_kinematics", (q,))):
        try:
            found = getattr(sd, name)(model, *given_)
        except (sd.InertiaError, sd.NonFiniteError):
            continue
        assert np.isfinite(found).all(), name


SOUND = """<robot name="r"><link name="b0"/>
<link name="b1"><inertial><origin xyz="0.1 0 0.2" rpy="0.1 0.2 0.3"/><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0.1" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="b0"/><child link="b1"/><origin xyz="0 0 1" rpy="0.1 0.2 0.3"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/><dynamics damping="1" friction="1"/></joint>
<link name="b2"/>
<joint name="j2" type="fixed"><parent link="b1"/><child link="b2"/><origin xyz="1 2 3"/></joint>
<link name="b3"><inertial><mass value="0"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j3" type="prismatic"><parent link="b2"/><child link="b3"/><axis xyz="1 2 3"/>
<mimic joint="j1" multiplier="2" offset="0.5"/></joint>
<link name="b4"><inertial><origin xyz="0 0.1 0"/><mass value="2"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j4" type="continuous"><parent link="b3"/><child link="b4"/><origin xyz="0 0 1"/></joint></robot>"""
TAGGED = [(e.tag, at, key) for at, e in enumerate(ET.fromstring(SOUND).iter()) for key in sorted(e.attrib)]
SPOTS = [(at, key) for _, at, key in TAGGED]
FIRST = {(tag, key): (at, key) for tag, at, key in reversed(TAGGED)}  # of each attribute of each element


@pytest.mark.parametrize(("at", "key"), slow_but([*FIRST.values()][::8], SPOTS))
def test_any_odd_value_at_any_place_loads_and_answers_or_is_refused(at: int, key: str) -> None:
    """Each value in each attribute in turn: the same cases whatever the version of Hypothesis."""
    numbers = (*NUMBERS, *ODD_NUMBERS, "4e307", "1.7e308", "-1.7e308")
    values = (*KINDS, *ODD_KINDS, *WORDS) if key in ("name", "link", "joint", "type") else numbers
    for value in (*TRIPLES, *(f"0 {x} 0.1" for x in numbers)) if key in ("xyz", "rpy") else values:
        root = ET.fromstring(SOUND)
        list(root.iter())[at].set(key, value)
        model = loaded(ET.tostring(root, encoding="unicode"), {})
        if model is not None:
            answers(model, at)
        if values is numbers:
            loaded(ET.tostring(root, encoding="unicode"), {"mimic": True, "inertia": "repair"})


def test_any_two_of_one_name_load_or_are_refused_by_name() -> None:
    """Each link and joint under the name of each other one, whatever their masses and inertials are."""
    names = [element.get("name", "") for element in ET.fromstring(SOUND) if element.get("name")]
    for first in range(len(names)):
        for second in range(len(names)):
            root = ET.fromstring(SOUND)
            one, other = list(root)[first], list(root)[second]
            one.set("name", names[second])
            if first != second and one.tag == other.tag:
                named = rf'<text>:\d+: .*(two {one.tag}s named "{names[second]}"|"{names[second]}" names itself)'
                with pytest.raises(sd.UrdfError, match=named):
                    sd.load_urdf(ET.tostring(root, encoding="unicode"))
            else:
                loaded(ET.tostring(root, encoding="unicode"), {})


@cases(80)
@given(robots(), mutations, options, place)
def test_a_mutated_robot_loads_and_answers_or_is_refused(robot: Any, changes: Any, chosen: Any, seed: int) -> None:
    model = loaded(ET.tostring(mutated(robot, changes), encoding="unicode"), chosen)
    if model is not None:
        answers(model, seed)


@cases(200)
@given(robots(), mutations, spoils, options, st.sampled_from(CODECS), st.booleans(), place)
def test_spoilt_text_loads_and_answers_or_is_refused(
    robot: Any, changes: Any, accidents: Any, chosen: Any, codec: str, binary: bool, seed: int
) -> None:
    text = ET.tostring(mutated(robot, changes), encoding="unicode")
    model = loaded(spoilt(text, accidents, codec, binary), chosen)
    if model is not None:
        answers(model, seed)


@pytest.mark.slow(quick="test_a_mutated_robot_loads_and_answers_or_is_refused")
@cases(320)
@given(robots(), mutations, options, place)
def test_four_times_as_many_mutated_robots_do(robot: Any, changes: Any, chosen: Any, seed: int) -> None:
    test_a_mutated_robot_loads_and_answers_or_is_refused.hypothesis.inner_test(robot, changes, chosen, seed)


@pytest.mark.slow(quick="test_spoilt_text_loads_and_answers_or_is_refused")
@cases(400)
@given(robots(), mutations, spoils, options, st.sampled_from(CODECS), st.booleans(), place)
def test_twice_as_many_spoilt_texts_do(
    robot: Any, changes: Any, accidents: Any, chosen: Any, codec: str, binary: bool, seed: int
) -> None:
    held = test_spoilt_text_loads_and_answers_or_is_refused.hypothesis.inner_test
    held(robot, changes, accidents, chosen, codec, binary, seed)


@cases(100)
@given(st.one_of(st.binary(max_size=200), st.text(max_size=200), values, st.sampled_from(HEADS + SPOILS)))
def test_what_is_no_urdf_is_refused(source: Any) -> None:
    with pytest.raises(sd.UrdfError):
        sd.load_urdf(source)


@cases(100)
@given(robots(), options, place)
def test_a_sound_robot_loads(robot: Any, chosen: Any, seed: int) -> None:
    """Else the tests above would pass by refusing everything."""
    sound = {k: v for k, v in chosen.items() if k == "continuous" or (k, v) == ("root", "floating")}
    model = loaded(ET.tostring(robot, encoding="unicode"), sound)
    assert model is not None
    answers(model, seed)


@cases(30)
@given(robots(), mutations)
def test_check_finds_something_to_say_of_every_robot(tmp_path_factory: Any, robot: Any, changes: Any) -> None:
    path = Path(tmp_path_factory.getbasetemp()) / "fuzzed.urdf"
    text = ET.tostring(mutated(robot, changes), encoding="unicode")
    path.write_bytes(text.encode("utf-8", errors="replace"))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message='robot "', category=UserWarning)
        assert main(["check", str(path)]) in (0, 1, 2)
