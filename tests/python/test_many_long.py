"""A million predictions."""

import numpy as np


def test_a_million_predictions(found, random):
    q = random.uniform(-1.0, 1.0, (1_000_000, 6))
    own = found.predict(q, "A")
    poses = found.flange_poses(q)
    target = next(t for t in found.result["targets"] if t["name"] == "A")["position"]
    np.testing.assert_allclose(own.position, poses[:, :3, :3] @ target + poses[:, :3, 3], atol=1e-12)
    assert np.isfinite(own.radius_95).all()
    some = random.integers(0, len(q), 100)
    np.testing.assert_array_equal(found.predict(q[some], "A").covariance, own.covariance[some])
