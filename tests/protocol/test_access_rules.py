from collections.abc import Iterator, Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.wire.access_rules import (
    Json,
    Kind,
    check_name,
    common_name,
    request_limits,
    robot_access,
    router_access,
    split_common_name,
    with_view,
)
from mbot_protocol.wire.keys import (
    ALIVE,
    CHUNK_BYTES,
    COMMAND,
    DOORS,
    PRESENCE,
    PUSH_CHUNK,
    TOPICS,
    Flow,
    Right,
)

NAMES = st.from_regex(r"[a-z0-9][a-z0-9_-]{0,31}", fullmatch=True)
RIGHTS = st.lists(st.sampled_from(Right), max_size=3)
QUERIES = [topic for topic in TOPICS if topic.flow is Flow.QUERY]


def allowed(access: Json, message: str, flow: str) -> Iterator[tuple[str, str]]:
    """(subject, key) for everything let through; subjects by name, or by protocol."""
    rules = {rule["id"]: rule for rule in access["rules"]}
    subjects = {subject["id"]: subject for subject in access["subjects"]}
    for policy in access["policies"]:
        for subject_id in policy["subjects"]:
            subject = subjects[subject_id]
            for name in subject.get("cert_common_names", subject.get("link_protocols")):
                for rule_id in policy["rules"]:
                    rule = rules[rule_id]
                    if message in rule["messages"] and flow in rule["flows"]:
                        yield from ((name, key) for key in rule["key_exprs"])


@given(st.dictionaries(NAMES, RIGHTS, max_size=4))
def test_exactly_those_with_the_right_may_ask(people: Mapping[str, list[Right]]) -> None:
    access = robot_access("mbot-1", people, (), loopback=False)
    assert access["default_permission"] == "deny"
    found = set(allowed(access, "query", "ingress"))
    assert found == {
        (common_name(Kind.PERSON, name), topic.key("mbot-1"))
        for name, rights in people.items()
        for topic in QUERIES
        if topic.right in with_view(rights)
    }


def test_a_right_brings_the_view_and_nothing_else() -> None:
    """Who may drive may not push, nor the other way round."""
    assert with_view([]) == frozenset()
    for right in Right:
        assert with_view([right]) == {right, Right.VIEW}
    access = robot_access("mbot-1", {"rosa": [Right.DRIVE]}, (), loopback=False)
    keys = {key for _, key in allowed(access, "query", "ingress")}
    assert COMMAND.key("mbot-1") in keys
    assert not {topic.key("mbot-1") for topic in TOPICS if topic.right is Right.PUSH} & keys


EVERYTHING = [
    *(("query", "ingress", topic) for topic in QUERIES),
    *(("reply", "egress", topic) for topic in QUERIES),
    *(("declare_queryable", "egress", topic) for topic in QUERIES),
    *(("put", "egress", topic) for topic in TOPICS if topic.flow is Flow.PUBLISH),
    *(("declare_subscriber", "ingress", topic) for topic in TOPICS if topic.flow is Flow.PUBLISH),
    *(
        ("liveliness_token", "ingress" if topic is PRESENCE else "egress", topic)
        for topic in TOPICS
        if topic.flow is Flow.LIVELINESS
    ),
    ("liveliness_query", "ingress", ALIVE),
    ("declare_liveliness_subscriber", "ingress", ALIVE),
    ("liveliness_query", "egress", PRESENCE),
]
"""What goes between a robot and a person with all rights; flows as the robot sees them."""


def test_a_router_and_whoever_has_logged_in_may_do_everything() -> None:
    """The router checks people itself."""
    access = robot_access("mbot-1", {"rosa": list(Right)}, ("lab",), loopback=True)
    assert access["enabled"] is True
    for message, flow, topic in EVERYTHING:
        found = {name for name, key in allowed(access, message, flow) if key == topic.key("mbot-1")}
        assert found == {"person:rosa", "router:lab", "tcp"}, (message, flow, topic.name)


def test_through_a_router_people_and_robots_come_as_far_as_without_one() -> None:
    access = router_access({"mbot-1": {"rosa": list(Right), "max": []}, "mbot-2": {}})
    assert access["enabled"] is True
    other = {"ingress": "egress", "egress": "ingress"}
    for message, flow, topic in EVERYTHING:
        for subject, direction in (("person:rosa", flow), ("robot:mbot-1", other[flow])):
            found = {key for name, key in allowed(access, message, direction) if name == subject}
            assert topic.key("mbot-1") in found, (subject, message, topic.name)
    named = {name for subject in access["subjects"] for name in subject["cert_common_names"]}
    assert named == {"person:rosa", "robot:mbot-1", "robot:mbot-2"}


def test_a_workstation_finds_the_doors_that_are_open_to_it() -> None:
    access = robot_access("mbot-1", {"rosa": [Right.VIEW]}, (), loopback=False)
    door = DOORS[Right.DRIVE].key("mbot-1")
    for message in ("liveliness_query", "declare_liveliness_subscriber"):
        searched = {key for _, key in allowed(access, message, "ingress")}
        assert searched == {"mbot/*/alive", "mbot/mbot-1/alive", f"{door.rpartition('/')[0]}/*"}
    shown = {key for _, key in allowed(access, "liveliness_token", "egress")}
    assert DOORS[Right.VIEW].key("mbot-1") in shown
    assert door not in shown, "what it may not do it is not told of"


@given(st.dictionaries(NAMES, RIGHTS, min_size=1, max_size=3), st.lists(NAMES, max_size=2))
def test_a_robot_touches_its_own_keys_only(
    people: Mapping[str, list[Right]], routers: list[str]
) -> None:
    access = robot_access("mbot-1", people, routers, loopback=True)
    for rule in access["rules"]:
        for key in rule["key_exprs"]:
            searching = set(rule["messages"]) <= {
                "liveliness_query",
                "declare_liveliness_subscriber",
            }
            assert key.startswith("mbot/mbot-1/") or (searching and key == "mbot/*/alive")


@given(st.dictionaries(NAMES, st.dictionaries(NAMES, RIGHTS, max_size=3), max_size=3))
def test_a_router_keeps_robots_apart(fleet: Mapping[str, Mapping[str, list[Right]]]) -> None:
    access = router_access(fleet)
    robots = {common_name(Kind.ROBOT, name): f"mbot/{name}/" for name in fleet}
    for message in ("put", "reply", "declare_queryable", "liveliness_token"):
        for subject, key in allowed(access, message, "ingress"):
            if subject in robots:
                assert key.startswith(robots[subject])
            else:
                assert message == "liveliness_token"
                assert key.endswith("/here/*")
    assert not {subject for subject, _ in allowed(access, "query", "ingress")} & set(robots)
    for subject, key in allowed(access, "query", "egress"):
        assert key.startswith(robots[subject])


@given(st.dictionaries(NAMES, st.dictionaries(NAMES, RIGHTS, max_size=3), max_size=3))
def test_what_zenoh_would_refuse_is_never_made(
    fleet: Mapping[str, Mapping[str, list[Right]]],
) -> None:
    """Identifiers are unique, nothing that is named is missing, no list of names is empty."""
    for access in (
        router_access(fleet),
        *(robot_access(r, people, ("lab",), loopback=True) for r, people in fleet.items()),
        *(robot_access(r, people, (), loopback=False) for r, people in fleet.items()),
    ):
        ids = {kind: [x["id"] for x in access[kind]] for kind in ("rules", "subjects", "policies")}
        for names in ids.values():
            assert len(set(names)) == len(names)
        for policy in access["policies"]:
            assert set(policy["rules"]) <= set(ids["rules"])
            assert set(policy["subjects"]) <= set(ids["subjects"])
            assert policy["rules"]
            assert policy["subjects"]
        assert all(s.get("cert_common_names", ["x"]) for s in access["subjects"])
        assert all(rule["key_exprs"] for rule in access["rules"])


def test_every_request_has_a_limit_and_a_chunk_fits() -> None:
    limits = {
        key: limit["size_limit"] for limit in request_limits("mbot-1") for key in limit["key_exprs"]
    }
    assert set(limits) == {topic.key("mbot-1") for topic in QUERIES}
    assert limits[PUSH_CHUNK.key("mbot-1")] > CHUNK_BYTES
    assert limits["mbot/mbot-1/command"] == 4096


@given(st.sampled_from(Kind), NAMES)
def test_a_name_in_a_certificate_says_what_it_belongs_to(kind: Kind, name: str) -> None:
    assert split_common_name(common_name(kind, name)) == (kind, name)
    assert len(common_name(kind, name)) <= 64  # X.509's limit


@pytest.mark.parametrize("text", ["", "rosa", "person:", "person:A", "robot:a b", "king:rosa"])
def test_a_foreign_certificate_is_nobodys(text: str) -> None:
    assert split_common_name(text) is None


@pytest.mark.parametrize("name", ["", "*", "a/b", "Ä", "a b", "A", "-a", "a" * 33, "person:rosa"])
def test_a_name_that_could_be_another_is_refused(name: str) -> None:
    with pytest.raises(ConfigurationError, match="expected 1 to 32"):
        check_name(name)
