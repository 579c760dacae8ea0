"""The transport over Zenoh, with the wire formats of rmw_zenoh_cpp; all that is known of Zenoh is in here.

`keys`, `tokens`, `qos` and `attachment` are the formats, pure functions of values; `config` is what sessions and
routers are opened with. Formats are those of Jazzy and Kilted; where Humble or Lyrical differ, the modules say so.

May import: what transport may.
"""
