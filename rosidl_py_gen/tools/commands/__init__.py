"""The commands as click knows them: names, arguments, help and completion, a file for each group.

Nothing but click is imported here; `run_command` loads what a command does. Where that has many options, it gets them
in one value, whose class stands beside what click is told of them.
"""
