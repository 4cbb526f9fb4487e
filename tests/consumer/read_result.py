import json
import numpy as np

with open("result.json", encoding="utf-8") as file:
    result = json.load(file)
names, rows = result["covariance"]["names"], result["covariance"]["lower_triangle"]
covariance = np.zeros((len(names), len(names)))
for i, row in enumerate(rows):  # row i has i + 1 numbers; null, which is not determined, becomes nan
    covariance[i, : i + 1] = covariance[: i + 1, i] = np.array(row, dtype=float)
error = {p["name"]: p["error"] for p in result["parameters"]}
for name, std in zip(names, np.sqrt(np.diag(covariance))):
    print(f"{name:8} {error[name]:12.8f} +- {std:.8f}" if name in error else f"{name:8} +- {std:.8f}")
