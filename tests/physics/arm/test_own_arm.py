"""The user's own arm: held against yourdfpy, and what a stranger's file may not do."""

from __future__ import annotations

import math
import os
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from icymoon.physics.arm import link_mesh
from icymoon.physics.arm import own_arm as own_arms
from icymoon.physics.arm.collisions import find_self_collisions, segment_distance
from icymoon.physics.arm.kinematics import forward_kinematics
from icymoon.physics.arm.lander_arm import describe_joints, joint_values, list_keypoints, make_arm, make_solids
from icymoon.physics.arm.link_mesh import read_link_mesh
from icymoon.physics.arm.own_arm import load_users_arm, make_arm_at
from icymoon.physics.arm.urdf import MAX_LINKS, read_urdf
from icymoon.physics.scene_checks import find_lander_reasons
from icymoon.settings import user_files
from icymoon.settings.description import defaults, merged
from icymoon.settings.topics.scene import Settings
from icymoon.support.errors import IcyMoonError
from urdf_files import CORNERS, FACES, JOINTS, LINKS, visual, write_ascii_stl, write_obj, write_robot, write_stl


def described(path, joints: str = "") -> Settings:
    return merged(defaults(), {"lander": {"kind": "OWN", "file": str(path), "joints": joints}})


def test_every_link_is_where_yourdfpy_puts_it(tmp_path):
    yourdfpy = pytest.importorskip("yourdfpy")  # of the extra "develop"
    path = write_robot(tmp_path)
    truth = yourdfpy.URDF.load(str(path), load_meshes=False, build_scene_graph=True)
    own = load_users_arm(described(path))
    arm = make_arm_at(own, np.eye(4))
    assert own.names == tuple(truth.actuated_joint_names) == ("yaw", "pitch", "reach")
    random, worst = np.random.default_rng(3), 0.0
    for angles in random.uniform((-math.pi, -1.0, 0.0), (math.pi, 2.0, 0.5), (500, 3)):
        truth.update_cfg(angles)
        for link, pose in zip(arm.links, forward_kinematics(arm, own.values(angles)), strict=True):
            worst = max(worst, float(np.abs(pose - truth.get_transform(link, "base")).max()))
    # Metres and sines: some roundings of double precision, and single precision of nothing.
    assert 0.0 < worst < 1e-12


def test_an_arm_adds_up_as_its_joints_do(tmp_path):
    joints = (
        '<joint name="a" type="revolute"><parent link="p"/><child link="q"/><origin xyz="0 0 0.5"/>'
        '<axis xyz="0 -2 0"/><limit lower="-2" upper="2"/></joint>'
        '<joint name="b" type="prismatic"><parent link="q"/><child link="r"/><origin xyz="1 0 0"/>'
        '<axis xyz="1 0 0"/><limit lower="0" upper="1"/></joint>'
    )
    settings = described(write_robot(tmp_path, joints, ("p", "q", "r")), "a=30 b=0.25")
    arm = make_arm(settings)
    place = np.linalg.inv(arm.base) @ forward_kinematics(arm, joint_values(settings))[-1]
    assert place[:3, 3] == pytest.approx([1.25 * math.cos(math.radians(30)), 0.0, 0.5 + 1.25 * 0.5], abs=1e-12)
    assert describe_joints(settings)["joints_deg"] == pytest.approx([30.0, 0.25])
    assert describe_joints(settings)["units"] == ["deg", "m"]
    assert not list(find_lander_reasons(settings))
    (reason,) = find_lander_reasons(described(tmp_path / "arm.urdf", "a=30 b=1.25"))
    assert "joint b at 1.25 m" in reason
    assert "0 m to 1 m" in reason


@pytest.mark.parametrize("write", [write_stl, write_ascii_stl, write_obj])
def test_meshes_of_each_format_are_the_same_triangles(tmp_path, write):
    vertices, triangles = read_link_mesh(write(tmp_path / f"m.{'obj' if write is write_obj else 'stl'}"))
    assert np.allclose(vertices[triangles], CORNERS[np.array(FACES)], atol=1e-8)  # STL has single precision


def test_a_mesh_is_scaled_turned_and_put_on_its_link(tmp_path):
    write_stl(tmp_path / "meshes" / "t.STL", 1000.0 * CORNERS)
    (tmp_path / "package.xml").write_text("<package/>", encoding="utf-8")
    (tmp_path / "urdf").mkdir()
    origin = '<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>'
    path = write_robot(
        tmp_path / "urdf",
        shapes={
            "tool": visual("package://robot/meshes/t.STL", "0.001 0.001 0.001", origin),
            "two": visual("../meshes/t.STL", "0.001 -0.001 0.001"),
        },
    )
    settings = described(path)
    solids = make_solids(settings)
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    tool = solids["tool"]
    assert np.allclose(tool.vertices[tool.triangles], CORNERS[np.array(FACES)] @ turned.T + [1, 2, 3], atol=1e-6)
    for link, solid in (("tool", tool), ("two", solids["two"])):  # mirrored: outside stays outside
        corners = solid.vertices[solid.triangles]
        centred = corners - solid.vertices.mean(axis=0)
        volume = np.einsum("ij,ij->i", centred[:, 0], np.cross(centred[:, 1], centred[:, 2])).sum() / 6
        assert volume == pytest.approx(0.1**3 / 6, rel=1e-5), link
    assert {name for name, *_ in list_keypoints(settings)} >= {"geared", "pitch"}
    files = user_files._list_parts(settings, "lander.file", path)
    assert [file.name for file in files] == ["arm.urdf", "t.STL"]


def test_capsules_contain_their_links(tmp_path):
    write_stl(tmp_path / "t.stl")
    shapes = {
        "one": '<visual><geometry><box size="0.5 0.1 0.1"/></geometry></visual>',
        "two": '<visual><geometry><cylinder radius="0.05" length="0.6"/></geometry></visual>',
        "three": '<visual><geometry><sphere radius="0.2"/></geometry></visual>',
        "tool": visual("t.stl"),
    }
    own = load_users_arm(described(write_robot(tmp_path, shapes=shapes)))
    assert [own.joints[capsule.link].link for capsule in own.capsules] == ["one", "two", "three", "tool"]
    for capsule in own.capsules:
        start, end = np.array(capsule.start), np.array(capsule.end)
        for point in own.solids[own.joints[capsule.link].link].vertices:
            assert segment_distance(start, end, point, point) <= capsule.radius_m * (1 + 1e-9) + 1e-12


def test_an_arm_that_reaches_into_itself_is_found(tmp_path):
    shapes = dict.fromkeys(("one", "three"), '<visual><geometry><box size="0.1 0.02 0.02"/></geometry></visual>')
    joints = JOINTS.replace('xyz="0.4 0 0.1"', 'xyz="-0.3 0 0"').replace('rpy="1.5707963 0.2 -0.4"', "")
    arm = make_arm(described(write_robot(tmp_path, joints, shapes=shapes)))
    assert find_self_collisions(arm, np.zeros(len(arm.joints))) == [("one", "three")]


BAD_JOINT = '<joint name="j" type="revolute"><parent link="base"/><child link="post"/>{}</joint>'
LIMIT = '<limit lower="0" upper="1"/>'
RING = "".join(
    f'<joint name="{a}{b}" type="fixed"><parent link="{a}"/><child link="{b}"/></joint>'
    for a, b in (("one", "two"), ("two", "one"))
)


@pytest.mark.parametrize(
    ("joints", "links", "words"),
    [
        (BAD_JOINT.format('<axis xyz="0 0 0"/>' + LIMIT), ("base", "post"), "has no length"),
        (BAD_JOINT.format('<axis xyz="0 nan 1"/>' + LIMIT), ("base", "post"), "not 3 numbers"),
        (BAD_JOINT.format('<origin xyz="1 2"/>' + LIMIT), ("base", "post"), "not 3 numbers"),
        (BAD_JOINT.format('<origin xyz="1e9 0 0"/>' + LIMIT), ("base", "post"), "up to 1000"),
        (BAD_JOINT.format(""), ("base", "post"), "has no limit"),
        (BAD_JOINT.format('<limit lower="2" upper="1"/>'), ("base", "post"), "exchange them"),
        (BAD_JOINT.format(LIMIT + '<mimic joint="j"/>'), ("base", "post"), "not a joint that moves by itself"),
        (BAD_JOINT.format(LIMIT).replace("revolute", "floating"), ("base", "post"), "'floating'"),
        (BAD_JOINT.format(LIMIT), ("base",), "'post', which is not a link"),
        (BAD_JOINT.format(LIMIT), ("base", "post", "loose"), "base and loose hang on no joint"),
        (RING, ("one", "two"), "make a ring"),
        (RING, ("base", "one", "two"), "is in a ring"),
        ("", tuple(f"l{k}" for k in range(MAX_LINKS + 1)), f"more than {MAX_LINKS}"),
        ("", (), "has no link"),
        ("", ("same", "same"), "two links that are called same"),
    ],
)
def test_a_robot_that_cannot_be_is_a_sentence(tmp_path, joints, links, words):
    path = write_robot(tmp_path, joints, links)
    with pytest.raises(IcyMoonError) as told:
        read_urdf(path)
    assert words in str(told.value)
    assert str(told.value).startswith(f"{path}: ")
    assert str(told.value).count("\n") == 0
    assert words in next(iter(find_lander_reasons(described(path))))  # refused, not a traceback


def test_entities_that_grow_are_refused_before_they_do(tmp_path):
    laughs = "".join(f'<!ENTITY l{k + 1} "{f"&l{k};" * 10}">' for k in range(9))
    before = f'<!DOCTYPE robot [<!ENTITY l0 "ha">{laughs}]>'
    with pytest.raises(IcyMoonError, match="document type"):
        read_urdf(write_robot(tmp_path, links=("base",), joints="<a>&l9;</a>", before=before))
    (tmp_path / "arm.urdf").write_text("<robot", encoding="utf-8")
    with pytest.raises(IcyMoonError, match="is not a URDF file that can be read"):
        read_urdf(tmp_path / "arm.urdf")
    (tmp_path / "arm.urdf").write_bytes(b"\xff\x00\x81")
    with pytest.raises(IcyMoonError, match="is no"):
        read_urdf(tmp_path / "arm.urdf")
    with pytest.raises(IcyMoonError, match=r"check lander\.file"):
        read_urdf(tmp_path / "none.urdf")


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        ("../secret.stl", "outside"),
        ("package://robot/../secret.stl", "outside"),
        ("file:///etc/hostname", "outside"),
        ("http://example.org/m.stl", "not a file of the folder"),
        ("missing.stl", "is not in"),
        ("", "is not in"),
        ("package://robot/missing.stl", "is not in"),
    ],
)
def test_meshes_are_of_the_robots_own_folder(tmp_path, mesh, words):
    write_stl(tmp_path / "secret.stl")
    (tmp_path / "in").mkdir()
    with pytest.raises(IcyMoonError, match=words):
        read_urdf(write_robot(tmp_path / "in", shapes={"one": visual(mesh)}))


def package(folder: Path, name: str = "") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "package.xml").write_text(f"<package><name> {name}\n</name></package>", encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("urdf", "mesh"),
    [
        ("urdf/robots/left/arm", "package://own/meshes/m.stl"),
        ("urdf/robots/left/arm", "../../../../meshes/m.stl"),
        ("", "package://own/meshes/m.stl"),
        ("a/b/c/d/e/f/g/h", "package://own/meshes/m.stl"),
        ("urdf/robots", "package://folder/meshes/m.stl"),
        ("urdf/robots", "package://renamed/meshes/m.stl"),
        ("urdf/robots", "package://beside/meshes/m.stl"),
        ("urdf/robots", "package://beside/meshes/a%20b.stl"),
        ("inner/urdf", "package://own/meshes/m.stl"),
        ("inner/urdf", "package://beside/meshes/m.stl"),
        ("inner/urdf", "package://within/meshes/m.stl"),
    ],
)
def test_a_mesh_is_found_in_its_package_and_in_one_beside(tmp_path, urdf, mesh):
    own = package(tmp_path / "src" / "folder", "own")
    package(own / "inner", "within")
    package(own.parent / "beside")
    for folder in (own, own.parent / "beside", own / "inner"):
        for name in ("m.stl", "a b.stl"):
            write_stl(folder / "meshes" / name)
    (own / urdf).mkdir(parents=True, exist_ok=True)
    (found,) = read_urdf(write_robot(own / urdf, shapes={"one": visual(mesh)})).files
    expected = own.parent / "beside" if "beside" in mesh else own / "inner" if "within" in mesh else own
    assert found.parent == (expected / "meshes").resolve()


def test_a_package_that_is_not_there_is_told_with_the_folders(tmp_path):
    own = package(tmp_path / "src" / "own", "own")
    write_stl(write_stl(own.parent / "none" / "m.stl").parent / "meshes" / "m.stl")  # without a package.xml
    (own / "urdf" / "arms").mkdir(parents=True)
    with pytest.raises(IcyMoonError) as caught:
        read_urdf(write_robot(own / "urdf" / "arms", shapes={"one": visual("package://none/m.stl")}))
    assert f"is not in {own}; copy it into {own}, or put the package 'none' beside it." in str(caught.value)
    package(own.parent / "other", "other")
    with pytest.raises(IcyMoonError) as caught:
        read_urdf(write_robot(own / "urdf" / "arms", shapes={"one": visual("package://other/m.stl")}))
    assert f"is not in {own.parent / 'other'} or {own}; copy it into" in str(caught.value)


@pytest.mark.parametrize(
    "mesh",
    [
        "package://../m.stl",
        "package://./../m.stl",
        "package:///../../m.stl",
        "package://other/../m.stl",
        "package://other/../../m.stl",
        "package://link/m.stl",
        "package://other/m.stl",
        "../../../m.stl",
        "package://own/../m.stl",
        "package://%2e%2e/m.stl",
        "package://../other/m.stl",
        "package://\\..\\m.stl",
        "package://%00/m.stl",
        f"package://{'a' * 4000}/m.stl",
        "package://",
    ],
)
def test_no_package_leads_outside(tmp_path, mesh):
    own = package(tmp_path / "src" / "own", "own")
    for folder in (own.parent, tmp_path, package(tmp_path / "secret", "link")):
        write_stl(folder / "m.stl")
    try:
        (own.parent / "link").symlink_to(tmp_path / "secret")
        (package(own.parent / "other") / "m.stl").symlink_to(tmp_path / "m.stl")
    except OSError:
        pytest.skip("this system makes no links")
    (own / "urdf").mkdir()
    with pytest.raises(IcyMoonError) as caught:
        read_urdf(write_robot(own / "urdf", shapes={"one": visual(mesh)}))
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 900


@pytest.mark.timeout(20)
@pytest.mark.parametrize(
    "content",
    [
        "",
        "<package>",
        "\0" * 100,
        "<!DOCTYPE a [<!ENTITY b 'own'>]><a>&b;</a>",
        "<package/>",
        "<package>" + " " * 2_000_000 + "</package>",
    ],
)
def test_a_package_whose_name_cannot_be_read_has_that_of_its_folder(tmp_path, content):
    own = package(tmp_path / "own")
    (own / "package.xml").write_text(content, encoding="utf-8")
    write_stl(own / "m.stl")
    (own / "urdf" / "arms").mkdir(parents=True)
    assert len(read_urdf(write_robot(own / "urdf" / "arms", shapes={"one": visual("package://own/m.stl")})).files) == 1


def test_a_link_out_of_the_folder_is_not_followed(tmp_path):
    secret = write_stl(tmp_path / "secret.stl")
    (tmp_path / "in").mkdir()
    try:
        (tmp_path / "in" / "m.stl").symlink_to(secret)
    except OSError:
        pytest.skip("this system makes no links")
    with pytest.raises(IcyMoonError, match="outside"):
        read_urdf(write_robot(tmp_path / "in", shapes={"one": visual("m.stl")}))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("m.stl", b"solid\n", "has no triangle"),
        ("m.stl", b"\0" * 90, "cut off"),
        ("m.stl", b"", "cut off"),
        ("m.stl", b"solid\nvertex 1 2 x\nvertex 0 0 0\nvertex 0 1 0\n", "the vertex of line 2 is not three numbers"),
        ("m.obj", b"v 0 0 0\nf 1 2 3\n", "the face of line 2 has vertex 3, but there are 1"),
        ("m.obj", b"v 0 0 0\nv 1 0 0\nf 0 1 2\nv 0 1 0\n", "the face of line 3 has vertex 0; they count from 1"),
        ("m.obj", b"v 0 0 0\nf -2 1 1\n", "vertex -2"),
        ("m.obj", b"v 0 0 0\nf 1 1 " + b"9" * 30, "but there are 1"),
        ("m.obj", b"v 0 0 0\nf 1 a/2 1\n", "the face of line 2 has 'a/2', not the number of a vertex"),
        ("m.obj", b"v 1 2\n", "the vertex of line 1 is not three numbers"),
        ("m.obj", b"v 0 0 inf\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "three numbers"),
        ("m.3ds", b"MM", "convert this one"),
    ],
)
def test_a_broken_mesh_is_a_sentence(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    path = write_robot(tmp_path, shapes={"one": visual(name)})
    (reason,) = find_lander_reasons(described(path))
    assert words in reason
    assert name in reason


def test_a_mesh_in_millimetres_is_told(tmp_path):
    write_stl(tmp_path / "m.stl", 1000.0 * CORNERS)
    (reason,) = find_lander_reasons(described(write_robot(tmp_path, shapes={"one": visual("m.stl")})))
    assert "millimetres" in reason


def test_a_face_may_come_before_its_vertices(tmp_path):
    lines = write_obj(tmp_path / "m.obj").read_text(encoding="utf-8").splitlines()
    vertices, triangles = read_link_mesh(tmp_path / "m.obj")
    (tmp_path / "n.obj").write_text(
        "\n".join(
            [
                *(line for line in lines if line.startswith("f") and "-" not in line),
                *(line for line in lines if line.startswith("v")),
            ]
        ),
        encoding="utf-8",
    )
    assert np.array_equal(read_link_mesh(tmp_path / "n.obj")[0], vertices)
    assert np.array_equal(read_link_mesh(tmp_path / "n.obj")[1], triangles[:2])


@pytest.mark.parametrize(
    "joints",
    ["base pan=10 pan=20 a,b=0.3", "base pan = 10, pan =20; a,b= 0.3", "10 20 0.3", "pan=20 a,b=0.3 base pan=10"],
)
def test_names_of_joints_may_have_spaces(tmp_path, joints):
    text = JOINTS
    for name, new in (("yaw", "base pan"), ("pitch", "pan"), ("reach", "a,b")):
        text = text.replace(f'"{name}"', f'"{new}"')
    facts = describe_joints(described(write_robot(tmp_path, text), joints))
    assert facts["joints"] == ["base pan", "pan", "a,b"]
    assert facts["joints_deg"] == pytest.approx([10.0, 20.0, 0.3])


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        ("elbow=3", "'elbow=3', but the joints"),
        ("elbow = 3", "'elbow = 3', but the joints"),
        ("yaw=x", "give a number"),
        ("elbow 3", "'elbow', but the joints of the arm that move are yaw, pitch, reach"),
        ("1 2 0 4", "name=value"),
        ("yaw=nan", "give a number"),
        ("ayaw=3", "'ayaw=3', but"),
        ("yaw=1=2", "'yaw=1=2'; give a number"),
    ],
)
def test_angles_of_joints_that_are_not_there_are_a_sentence(tmp_path, joints, words):
    (reason,) = find_lander_reasons(described(write_robot(tmp_path), joints))
    assert words in reason


def test_values_without_names_are_in_the_order_of_the_file(tmp_path):
    facts = describe_joints(described(write_robot(tmp_path), "10, 20; 0.3"))
    assert facts["joints"] == ["yaw", "pitch", "reach"]
    assert facts["joints_deg"] == pytest.approx([10.0, 20.0, 0.3])


def test_a_link_with_a_name_of_ours_gets_another(tmp_path):
    box = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'
    path = write_robot(tmp_path, JOINTS.replace('"tool"', '"body"'), (*LINKS[:-1], "body"), {"body": box})
    assert {"body", "arm_body"} <= set(make_solids(described(path)))


def test_names_of_links_stay_apart_whatever_they_are(tmp_path):
    ball = '<visual><geometry><sphere radius="0.1"/></geometry></visual>'
    names = ("base", "body", "arm_body", "arm_arm_body")
    joints = "".join(
        f'<joint name="j{k}" type="fixed"><parent link="base"/><child link="{name}"/></joint>'
        for k, name in enumerate(names[1:])
    )
    own = load_users_arm(described(write_robot(tmp_path, joints, names, dict.fromkeys(names, ball))))
    assert len({joint.link for joint in own.joints}) == len(own.solids) == 4
    assert "body" not in own.solids


@pytest.mark.long
def test_one_mesh_many_times_is_refused_before_all_are_made(tmp_path, monkeypatch):
    write_stl(tmp_path / "m.stl")
    made = []
    monkeypatch.setattr(own_arms, "MAX_TRIANGLES", 100)
    of_shape = own_arms._make_shape_solid
    monkeypatch.setattr(
        own_arms, "_make_shape_solid", lambda shape, *rest: made.append(shape) or of_shape(shape, *rest)
    )
    shapes = {"one": visual("m.stl") * 20, "two": visual("m.stl") * 9000}
    (reason,) = find_lander_reasons(described(write_robot(tmp_path, shapes=shapes)))
    assert "more than 100 triangles" in reason
    assert len(made) == 100 // len(FACES) + 1


def test_macros_that_are_not_expanded_are_told(tmp_path):
    (tmp_path / "arm.urdf").write_text(
        '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arm n="1"/><link name="a"/></robot>', encoding="utf-8"
    )
    (reason,) = find_lander_reasons(described(tmp_path / "arm.urdf"))
    assert "expand it first" in reason


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with a name are of Unix")
def test_a_pipe_is_no_file_and_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "arm.urdf")
    (reason,) = find_lander_reasons(described(tmp_path / "arm.urdf"))
    assert "is not a file" in reason


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
SQUARE = b"solid x\nouter loop\n" + b"".join(b"vertex %d %d 0\n" % each for each in ((0, 0), (1, 0), (0, 1)))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("m.stl", b"solid x\n" + b"\n" * 300_000 + b"endsolid"),
        ("m.stl", b"solid x" + b" " * 10**6),
        ("m.stl", b" " * 10**6),
        ("m.stl", b"solid x\n" + b"vertex\n" * 10**5),
        ("m.stl", b"solid\nvertex 1 2\n"),
        ("m.stl", b"solid\n" + b"\r" * 10**6),
        ("m.stl", SQUARE + b"vertex 1 1 1\n"),
        ("m.stl", SQUARE.replace(b"1 0 0", b"1 " + b"1" * 70_000 + b" 0")),
        ("m.stl", SQUARE.replace(b"1 0 0", b"1 nan 0")),
        ("m.stl", SQUARE.replace(b"1 0 0", b"1 1e999 0")),
        ("m.stl", SQUARE.replace(b"1 0 0", b"1 0x1 0")),
        ("m.stl", SQUARE.replace(b"1 0 0", b"1 0,5 0")),
        ("m.stl", b"\0" * 80 + b"\xff" * 4 + bytes(50)),
        ("m.stl", bytes(84)),
        ("m.stl", bytes(80) + b"\2\0\0\0" + bytes(50)),
        ("m.stl", bytes(80) + b"\1\0\0\0" + b"\xff" * 50),
        ("m.stl", SQUARE.replace(b"outer", b"\0\x1b[31m").replace(b"v", b"V")),
        ("m.obj", (OBJ + "f " + "1 2 3 " * 300_000).encode()),
        ("m.obj", (OBJ + "f 1 2 4\n").encode()),
        ("m.obj", (OBJ + "f 1 2 -4\n").encode()),
        ("m.obj", (OBJ + "f 1 2 3.5\n").encode()),
        ("m.obj", (OBJ + "f 1 2\n").encode()),
        ("m.obj", (OBJ + f"f 1 2 {'9' * 5000}\n").encode()),
        ("m.obj", (OBJ + f"f 1 2 {'9' * 19}\n").encode()),
        ("m.obj", (OBJ + f"f 1 2 -{'9' * 19}\n").encode()),
        ("m.obj", (OBJ + f"v {'9' * 5000} 0 0\nf 1 2 3\n").encode()),
        ("m.obj", (OBJ + "f 1 2 /3\n").encode()),
        ("m.obj", OBJ.replace("1 0 0", "0,5 1,25 0").encode() + b"f 1 2 3\n"),
        ("m.obj", OBJ.replace("1 0 0", "zzz 0 0").encode()),
        ("m.obj", (OBJ * 1000).encode()),
        ("m.obj", b"\0" * 10**6),
        ("m.obj", b"\n" * 10**6),
        ("m.obj", b"v " * 10**6),
        ("m.obj", b"f\n" * 10**5),
        ("m.obj", OBJ.encode("utf-16")),
        ("m.obj", b"v 1\xa02 3 4\xff\n"),
        ("m.obj", b""),
    ],
    ids=range(37),
)
@pytest.mark.timeout(20)
def test_a_hostile_mesh_is_a_sentence(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(IcyMoonError) as caught:
        read_link_mesh(tmp_path / name)
    assert str(caught.value).startswith(f"{tmp_path / name}: ")
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("m.obj", OBJ + "f 1 2 3 1 2 3 1\n" * 30),
        ("m.obj", OBJ * 200),
        ("m.stl", SQUARE.decode() + "vertex 0 0 1\n" * 900),
    ],
)
def test_a_mesh_is_counted_while_it_is_read(tmp_path, monkeypatch, name, text):
    monkeypatch.setattr(link_mesh, "MAX_TRIANGLES", 100)
    (tmp_path / name).write_text(text + "what is no line of a mesh\n" + "f 1 x\nvertex 1\n", encoding="utf-8")
    with pytest.raises(IcyMoonError, match=r"has more than (100 triangles|300 vertices)"):
        read_link_mesh(tmp_path / name)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with a name are of Unix")
@pytest.mark.parametrize("name", ["m.stl", "m.obj"])
def test_a_mesh_that_is_no_file_is_not_waited_for(tmp_path, name):
    (tmp_path / f"folder.{name[2:]}").mkdir()
    os.mkfifo(tmp_path / name)
    for path in (tmp_path / name, tmp_path / f"folder.{name[2:]}", tmp_path / f"absent.{name[2:]}"):
        with pytest.raises(IcyMoonError, match="cannot be read"):
            read_link_mesh(path)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("write", [write_stl, write_ascii_stl, write_obj])
def test_a_damaged_mesh_is_a_mesh_or_a_sentence(tmp_path, write, seed):
    path = write(tmp_path / f"m.{'obj' if write is write_obj else 'stl'}")
    whole, random = path.read_bytes(), np.random.default_rng(seed)
    for _ in range(60):
        data = bytearray(whole)
        for at in random.integers(0, len(data), 3):
            data[at] = random.integers(0, 256)
        path.write_bytes(data)
        with suppress(IcyMoonError):
            vertices, triangles = read_link_mesh(path)
            assert np.isfinite(vertices).all()
            assert triangles.min() >= 0
            assert triangles.max() < len(vertices)


ROBOT = '<robot name="a"><link name="b">{}</link></robot>'
VISUAL = "<visual><geometry>{}</geometry></visual>"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "\0",
        "<robot>",
        "<robot/>",
        "<a/>",
        "<robot>" * 300_000,
        "<robot " + 'a="" ' * 10,
        '<robot a="1" a="2"/>',
        "<!doctype robot><robot/>",
        "<?xml version='1.0' encoding='none'?><robot/>",
        ROBOT.replace('"b"', '"\n"').format(""),
        ROBOT.replace('"b"', '"&#27;[31m"').format(""),
        ROBOT.replace('"b"', f'"{"b" * 81}"').format(""),
        ROBOT.format("<visual/>"),
        ROBOT.format(VISUAL.format("")),
        ROBOT.format(VISUAL.format("<torus/>")),
        ROBOT.format(VISUAL.format('<box size="1 1"/>')),
        ROBOT.format(VISUAL.format('<box size="1 1 -1"/>')),
        ROBOT.format(VISUAL.format('<box size="1 1 0"/>')),
        ROBOT.format(VISUAL.format('<sphere radius="nan"/>')),
        ROBOT.format(VISUAL.format('<sphere radius="1e999"/>')),
        ROBOT.format(VISUAL.format("<sphere/>")),
        ROBOT.format(VISUAL.format(f'<sphere radius="{"1" * 10**6}"/>')),
        ROBOT.format(VISUAL.format("<mesh/>")),
        ROBOT.format(VISUAL.format('<mesh filename="%00"/>')),
        ROBOT.format(VISUAL.format('<mesh filename="."/>')),
        ROBOT.format(VISUAL.format(f'<mesh filename="{"a/" * 10**5}m.stl"/>')),
        ROBOT.format(VISUAL.format('<mesh filename="m.stl" scale="0 1 1"/>')),
        ROBOT.format("<x>" * 10**5 + "</x>" * 10**5).replace("robot", "r"),
        ROBOT.format('<visual><origin xyz="1,0 0 0"/><geometry><box size="1 1 1"/></geometry></visual>'),
    ],
    ids=range(30),
)
@pytest.mark.timeout(20)
def test_a_hostile_robot_is_a_sentence(tmp_path, text):
    (tmp_path / "arm.urdf").write_text(text, encoding="utf-8")
    with pytest.raises(IcyMoonError) as caught:
        read_urdf(tmp_path / "arm.urdf")
    assert str(caught.value).startswith(f"{tmp_path / 'arm.urdf'}")
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 600


@pytest.mark.timeout(20)
def test_a_mesh_that_is_named_many_times_is_read_once(tmp_path, monkeypatch):
    (tmp_path / "m.obj").write_text(OBJ + "f 1 2 3\n" + "# nothing\n" * 10**5, encoding="utf-8")
    read = []
    monkeypatch.setattr(own_arms, "read_link_mesh", lambda path: read.append(path) or read_link_mesh(path))
    own = load_users_arm(described(write_robot(tmp_path, "", ("base",), {"base": visual("m.obj") * 300})))
    assert len(own.solids["base"].triangles) == 300
    assert len(read) == 1


def test_vertices_without_triangles_count(tmp_path, monkeypatch):
    monkeypatch.setattr(own_arms, "MAX_TRIANGLES", 100)
    (tmp_path / "m.obj").write_text(OBJ * 50 + "f 1 2 3\n", encoding="utf-8")
    (reason,) = find_lander_reasons(described(write_robot(tmp_path, shapes={"one": visual("m.obj") * 3})))
    assert "more than 100 triangles" in reason
