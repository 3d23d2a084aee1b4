"""The tables: each module measures one, `measure(quick) -> Section`."""
