"""The files of a run: its manifest, its store of records and images, Parquet files and features."""
