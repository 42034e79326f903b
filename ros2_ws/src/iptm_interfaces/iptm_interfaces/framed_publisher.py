"""Puts what a vehicle says into frames of its own, so that several vehicles share one graph."""

from __future__ import annotations

from typing import Any

from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message, serialize_message

from iptm_interfaces.topics import frame_in


class FramedPublisher(Publisher):
    """A publisher that prefixes the frames of a message with the namespace of the vehicle.

    Codecs know the frames of the topic table only; without a namespace nothing is changed or copied.

    Attributes:
        namespace: full namespace of the vehicle, `/` for none.
    """

    namespace = "/"

    def publish(self, msg: Any) -> None:
        """Publish a message, or its serialised bytes."""
        if self.namespace != "/":
            msg = self._framed(msg)
        super().publish(msg)

    def _framed(self, message: Any) -> Any:
        if isinstance(message, bytes):
            return serialize_message(self._framed(deserialize_message(message, self.msg_type)))
        header = getattr(message, "header", None)
        if header is not None:
            header.frame_id = frame_in(self.namespace, header.frame_id)
        if hasattr(message, "child_frame_id"):
            message.child_frame_id = frame_in(self.namespace, message.child_frame_id)
        return message
