"""The protobuf reader against the `protobuf` package, through messages of ONNX, and against published examples."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx import AttributeProto, NodeProto, TensorProto

from contract.release.protobuf import Field, Kind, read

INT64 = st.integers(-(2**63), 2**63 - 1)
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)


def test_the_published_examples():
    """https://protobuf.dev/programming-guides/encoding: `a: 150`, `b: "testing"`, and packed 3, 270, 86942."""
    schema = {1: Field("a", Kind.INT), 2: Field("b", Kind.TEXT), 6: Field("f", Kind.INT, most=3)}
    assert read(memoryview(bytes.fromhex("089601")), schema)["a"] == 150
    assert read(memoryview(bytes.fromhex("120774657374696e67")), schema)["b"] == "testing"
    assert read(memoryview(bytes.fromhex("3206038e029ea705")), schema)["f"] == [3, 270, 86942]


@given(dims=st.lists(INT64, max_size=5), kind=st.integers(0, 20), raw=st.binary(max_size=300), name=TEXT)
def test_a_tensor_reads_as_it_was_written(dims, kind, raw, name):
    schema = {
        1: Field("dims", Kind.INT, most=5),
        2: Field("data_type", Kind.INT),
        8: Field("name", Kind.TEXT),
        9: Field("raw_data", Kind.BYTES),
    }
    content = TensorProto(dims=dims, data_type=kind, name=name, raw_data=raw).SerializeToString()
    found = read(memoryview(content), schema)
    assert (found["dims"], found["data_type"], found["name"], bytes(found["raw_data"])) == (dims, kind, name, raw)


@given(number=st.floats(width=32, allow_nan=False), names=st.lists(TEXT, max_size=4))
def test_floats_and_lists_of_text_read_as_they_were_written(number, names):
    assert read(memoryview(AttributeProto(f=number).SerializeToString()), {2: Field("f", Kind.FLOAT)})["f"] == number
    node = NodeProto(input=names).SerializeToString()
    assert read(memoryview(node), {1: Field("input", Kind.TEXT, most=4)})["input"] == names


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ("08", "ends within a number"),
        ("0896", "ends within a number"),
        ("08" + "ff" * 9 + "02", "more than 64 bits"),
        ("08" + "80" * 10 + "00", "more than 64 bits"),
        ("12057465", "field 2 ends behind its message"),
        ("12ffffffffffffffffff01", "field 2 ends behind its message"),
        ("0a0101", "a is not stored as int"),
        ("1001", "b is not stored as text"),
        ("15aabbccdd", "b is not stored as text"),
        ("1201ff", "invalid start byte"),
        ("0b0c", "field 1 has wire type 3"),
        ("090000000000000000", "field 1 has wire type 1"),
        ("0f", "field 1 has wire type 7"),
        ("0001", "a field has number 0"),
        ("4801", "field 9 is not expected"),
        ("08010802", "a is there twice"),
        ("3203010203" + "3001", "f is there more than 3 times"),
        ("320401020304", "f is there more than 3 times"),
    ],
)
def test_what_is_no_message_is_refused(content, named):
    schema = {1: Field("a", Kind.INT), 2: Field("b", Kind.TEXT), 6: Field("f", Kind.INT, most=3)}
    with pytest.raises(ValueError, match=named):
        read(memoryview(bytes.fromhex(content)), schema)
