"""Fetched drives looked through by a person: kept or dropped, labelled, split, exported."""
