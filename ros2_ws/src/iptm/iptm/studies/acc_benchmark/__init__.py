"""The default strategy behind measured lead vehicles, compared with the adaptive cruise controls there."""
