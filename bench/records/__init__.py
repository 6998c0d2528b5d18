"""What a run keeps on disk: records, journal, artifacts, Parquet files, features."""
