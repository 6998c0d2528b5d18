"""The literal tables: suites, methods, metrics, parameters, condition families, plug-ins."""
