"""Store what ``mbstab eig`` prints for the shipped models: ``python tests/truths/make_gallery.py``.

Models whose eigenvalues differ by rounding only stay as they are.
"""

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import gallery

from mbstab.model.library import installed_models


def main():
    """Write the store, one line for each model."""
    before = gallery.stored() if gallery.STORE.exists() else {}
    lines = []
    for path in installed_models():
        found, known = gallery.printed(path), before.get(path.name)
        if known is not None and gallery.farthest(found["eigenvalues"], known["eigenvalues"]) <= gallery.ROUNDING:
            found["eigenvalues"] = known["eigenvalues"]
        if found != known:
            print(f"{path.name}: {'new' if known is None else 'changed'}")
        lines.append(f"{json.dumps(path.name)}: {json.dumps(found, ensure_ascii=False)}")
    gallery.STORE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
