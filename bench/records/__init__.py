"""The files of a run: records, journal, artifacts, Parquet files and features."""
