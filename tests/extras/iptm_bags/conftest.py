"""The bags of the tests of recording."""

from tests.iptm_ros.recording.conftest import encode, small_bag, write_run  # noqa: F401
from tests.iptm_ros.recording.test_foreign_readers import old_bag  # noqa: F401
from tests.iptm_ros.recording.test_split_bags import split_bag  # noqa: F401
