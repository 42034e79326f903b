"""Numbers straight from bytes: the same as by the decoder of the type, and none from another form."""

import pytest
from rclpy.serialization import deserialize_message

from iptm_ros.codecs import numbers_of, read_numbers, stamp_of
from iptm_ros.codecs.numbers import LAYOUTS
from iptm_ros.topics import TOPICS, Topic

READ = [topic for topic in LAYOUTS if TOPICS[topic].type_name != "sensor_msgs/msg/Temperature"]
READ.remove(Topic.PLANT_ACCELERATION)


@pytest.mark.parametrize("prefix", ["", "car_1", "a/b"])
@pytest.mark.parametrize("topic", READ)
def test_equal_to_the_decoder(topic, prefix):
    values = [0.25 + number for number in range(len(LAYOUTS[topic].numbers))]
    if topic is Topic.PLANT_STATE:
        values = [min(value, 1.0) for value in values]
    data = LAYOUTS[topic].data(12_345_678_901, values, prefix)
    found, message = numbers_of(topic, data), deserialize_message(data, TOPICS[topic].message_type)
    assert found.stamp_ns == stamp_of(found) == stamp_of(message) == 12_345_678_901
    assert read_numbers(topic, found) == read_numbers(topic, message) == values
    padded = bytearray(data)
    padded[12 + 4 + len(f"{prefix}x")] ^= 1  # another frame of the same length
    assert numbers_of(topic, bytes(padded)).packed == found.packed


@pytest.mark.parametrize("topic", READ)
def test_another_form_is_left_to_the_decoder(topic):
    data = LAYOUTS[topic].data(0, [0.5] * len(LAYOUTS[topic].numbers), "")
    for other in (b"\x00\x00" + data[2:], data[:-8], data + bytes(8), data[:15], b""):
        assert numbers_of(topic, other) is None
    if topic is not Topic.LEADER and topic is not Topic.PLANT_ODOMETRY:
        name = next(iter(TOPICS[topic].fields)).encode()
        assert numbers_of(topic, data.replace(name, name[::-1], 1)) is None
