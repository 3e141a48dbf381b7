"""The messages: one frozen dataclass per payload, by subject; the table `topics`, a line for each with its consumers.

Key on the bus: `<robot>/<module>/<variable>`. Every payload has `t_s`, when its content was measured on the sender's
clock; every output has `valid`, false when an input it rests on was not alive and valid. Sequence number and boot id
travel in the envelope (`codec.Envelope`), stamped by the bus. The codec holds every field to the bounds of its type
(`fields`). Add fields with a default, never reuse one, and rename one only with its former name (`Formerly`): old
recordings must load.
"""
