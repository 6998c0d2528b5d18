"""The contracts of methods, metrics and datasets, and the checks of plug-ins: `bench test`."""
