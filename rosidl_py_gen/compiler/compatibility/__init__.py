"""What became of definitions: two sets of them compared, and messages of the first carried over to the second.

Nothing here reads files, bags or networks: facts in, frozen results out.
"""
