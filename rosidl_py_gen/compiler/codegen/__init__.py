"""From checked definitions to Python source: layout -> plan -> view -> text. `sources` is where others come in."""
