"""The bundled networks by which drawn images are measured, with their weights."""

from pathlib import Path

VIEWS_WEIGHTS = Path(__file__).with_name("views_network.safetensors")
JUDGE_WEIGHTS = Path(__file__).with_name("judge_network.safetensors")
