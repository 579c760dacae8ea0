"""Options of content filters; a module of rclpy 10."""

from typing import NamedTuple


class ContentFilterOptions(NamedTuple):
    """Content filter of a subscription, as `Subscription.set_content_filter` takes it."""

    filter_expression: str
    expression_parameters: list[str]
