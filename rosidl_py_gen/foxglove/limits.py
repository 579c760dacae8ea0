"""Limits for viewers of the command ``foxglove``; docs/howto/live-view.md lists the main limits.

The event loop serves every viewer, so no viewer may occupy the loop for long or make the process grow. Data that exceed
a limit are refused with a status that names the limit; a viewer that does not read its messages is disconnected.
"""

from __future__ import annotations

MAX_VIEWERS = 64
"""Maximum number of viewers that may be connected to the server at the same time."""
MAX_TEXT = 1 << 20
"""Maximum number of characters of a text message from a viewer, and of bytes of a message published as JSON.

Parsing 1 MiB holds the GIL for at most 0.1 s; 16 MiB took 0.5 s, and 1.3 GB as lists of lists.
"""
MAX_ENTRIES = 8192
"""Maximum number of entries of a list in a text message, such as subscriptions or names of parameters."""
MAX_VALUES = 1 << 14
"""Maximum number of list elements in one setParameters message."""
MAX_NAME = 1024
"""Maximum number of characters of each name, type, encoding and request id that a viewer sends."""
MAX_STATUSES = 8
"""Maximum number of refused entries of one message that are reported to the viewer one by one; others are counted."""
MAX_WARNINGS = 32
"""Maximum number of different warnings that are sent to all viewers in a second."""
MAX_STATUS_LENGTH = 4000
"""Maximum number of characters of a status message to a viewer."""

MAX_CLIENT_CHANNELS = 64
"""Maximum number of topics that a viewer publishes on at the same time."""
MAX_WAITING = 10
"""Maximum number of messages from a viewer for one topic that wait until the type of the topic is known."""
MAX_WAITING_BYTES = 1 << 20
"""Maximum size in bytes of all messages from a viewer that wait until the types of their topics are known."""
MAX_NESTED_BYTES = 1 << 20
"""Maximum size in bytes of a CDR message or request with a sequence of strings, or of messages that contain strings or
sequences: such data become up to 500 bytes of objects for 4 bytes sent.
"""
MAX_DEFAULTS = 1 << 20
"""Maximum number of values of a message that a viewer publishes as JSON. Omitted fields count, because they get their
defaults."""
MAX_INLINE = 8192
"""Maximum number of bytes, and of values, of a message that is decoded on the event loop; larger messages are decoded
in a thread."""

MAX_SCHEMA_BYTES = 1 << 15
"""Maximum size in bytes of a definition that a viewer sends. Compiling takes about 30 ms for each KiB, in a thread.

32 KiB hold the GIL for up to 0.17 s on a busy machine, 64 KiB for up to 0.44 s.
"""
MAX_VIEWER_SCHEMA_BYTES = 1 << 18
"""Maximum size in bytes of the definitions that one viewer sends for the topics it publishes on."""
MAX_SCHEMAS = 256
"""Maximum number of different definitions that viewers send until the command ends; their classes are never freed."""
MAX_SCHEMAS_BYTES = 1 << 20
"""Maximum size in bytes of all different definitions that viewers send until the command ends."""

MAX_FOLLOWED = 8192
"""Maximum number of parameters that a viewer can subscribe to by name, to be sent their changes."""
MAX_FOLLOWED_LENGTH = 1 << 19
"""Maximum number of characters of the names of all parameters that a viewer has subscribed to."""

MAX_JOBS = 64
"""Maximum number of service calls and parameter requests of one viewer that are in flight."""
MAX_JOB_BYTES = 16 << 20
"""Maximum size in bytes of all service calls and parameter requests of one viewer in flight; a larger one must be
alone."""
MAX_CONTROL_MESSAGES = 4096
"""Maximum number of texts, times and service responses that wait to be sent to a viewer. Times alone can be 30 in a
second."""
MAX_CONTROL_BYTES = 64 << 20
"""Maximum size in bytes of the texts, times and responses that wait for a viewer, and separately of the waiting
messages of topics."""

MAX_ANSWER_BYTES = 1 << 18
"""Maximum size in bytes of the replies to pings that wait to be sent to a viewer."""

READ_BYTES = 1 << 12
"""Number of bytes read from a viewer's connection at once; asyncio's default, 256 KiB, full of pings takes 0.3 s."""
HEAVY_TEXT = 1 << 16
"""Minimum number of characters of a text message that counts as long: the server handles one long message at a time,
with pauses."""
PAUSE_FROM_S = 0.001
"""Handling time of a message in seconds above which the server stops reading from the viewer for the same time."""
