"""Options of content filters; a module of rclpy 10."""

from typing import NamedTuple


class ContentFilterOptions(NamedTuple):
    """Expression and parameters of a subscription's content filter; see `Subscription.set_content_filter`."""

    filter_expression: str
    expression_parameters: list[str]
