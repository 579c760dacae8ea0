"""Limits for viewers of ``foxglove``, the main ones of which are in docs/howto/live-view.md.

The event loop serves every viewer, so no viewer may occupy it for long or make the process grow. What exceeds a limit
is refused with a status that names the number; a viewer that does not read what is sent to it is disconnected.
"""

from __future__ import annotations

MAX_VIEWERS = 64
"""Number of connections at a time."""
MAX_TEXT = 1 << 20
"""Characters of a text message, and bytes of a message published as JSON.

Parsing 1 MiB holds the GIL for at most 0.1 s; 16 MiB took 0.5 s, and 1.3 GB as lists of lists.
"""
MAX_ENTRIES = 8192
"""Entries of a list in a text message, such as subscriptions or names of parameters."""
MAX_VALUES = 1 << 14
"""Maximum number of list elements in one setParameters message."""
MAX_NAME = 1024
"""Characters of a name, a type, an encoding and the id of a request."""
MAX_STATUSES = 8
"""Refused entries of one message that are reported one by one; the others are counted."""
MAX_WARNINGS = 32
"""Different warnings to all viewers in a second."""
MAX_STATUS_LENGTH = 4000
"""Characters of a status."""

MAX_CLIENT_CHANNELS = 64
"""Topics that a viewer publishes on at a time."""
MAX_WAITING = 10
"""Messages of a topic that wait until its type is known."""
MAX_WAITING_BYTES = 1 << 20
"""Size of the messages that wait for a type, for all topics of a viewer."""
MAX_NESTED_BYTES = 1 << 20
"""Size of a CDR message or request with a sequence of strings, or of messages that contain strings or sequences: these
become up to 500 bytes of objects for 4 bytes sent.
"""
MAX_DEFAULTS = 1 << 20
"""Values of a message published as JSON, with those that a JSON object leaves to their defaults."""
MAX_INLINE = 8192
"""Bytes, and values, of a message that is decoded on the event loop; larger ones are decoded in a thread."""

MAX_SCHEMA_BYTES = 1 << 15
"""Size of a definition that a viewer sends. Compiling takes about 30 ms for each KiB, in a thread.

32 KiB hold the GIL for up to 0.17 s on a busy machine, 64 KiB for up to 0.44 s.
"""
MAX_VIEWER_SCHEMA_BYTES = 1 << 18
"""Size of the definitions for all topics that a viewer publishes on."""
MAX_SCHEMAS = 256
"""Definitions of all viewers until the command ends, each counted once; their classes are never freed."""
MAX_SCHEMAS_BYTES = 1 << 20
"""Size of all definitions of viewers."""

MAX_FOLLOWED = 8192
"""Parameters that a viewer follows by name."""
MAX_FOLLOWED_LENGTH = 1 << 19
"""Characters of the names of followed parameters."""

MAX_JOBS = 64
"""Calls and parameter requests of a viewer in flight."""
MAX_JOB_BYTES = 16 << 20
"""Size of the calls and parameter requests in flight; a larger one must be alone."""
MAX_CONTROL_MESSAGES = 4096
"""Text messages, times and responses that wait for a viewer; most are times, 30 in a second."""
MAX_CONTROL_BYTES = 64 << 20
"""Size of waiting text messages, times and responses, and of waiting messages of topics except the newest."""

MAX_ANSWER_BYTES = 1 << 18
"""Size of the replies to pings that wait for a viewer."""

READ_BYTES = 1 << 12
"""Bytes read from a connection at once; asyncio's 256 KiB full of pings take 0.3 s each."""
HEAVY_TEXT = 1 << 16
"""Characters from which text messages of all viewers are parsed one at a time, with pauses."""
PAUSE_FROM_S = 0.001
"""Handling time from which the viewer is paused for the same time."""
