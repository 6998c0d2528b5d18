"""The bundled networks that measure: their weights and their trainings."""

from pathlib import Path

VIEWS_WEIGHTS = Path(__file__).with_name("views_network.safetensors")
JUDGE_WEIGHTS = Path(__file__).with_name("judge_network.safetensors")
