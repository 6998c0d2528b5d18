"""The suite `stability`: extreme inputs, and whether the outcomes are as stated."""
