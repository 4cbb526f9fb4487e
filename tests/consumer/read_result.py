import json
import numpy as np

with open("result.json", encoding="utf-8") as file:
    result = json.load(file)
names = result["covariance"]["names"]
covariance = np.array(result["covariance"]["matrix"], dtype=float)  # null, which is not determined, becomes nan
error = {p["name"]: p["error"] for p in result["parameters"]}
for name, std in zip(names, np.sqrt(np.diag(covariance))):
    print(f"{name:8} {error[name]:12.8f} +- {std:.8f}" if name in error else f"{name:8} +- {std:.8f}")
