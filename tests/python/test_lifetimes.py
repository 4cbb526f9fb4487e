"""Lifetimes, threads, and long work that is stopped."""

import gc
import os
import signal
import threading
import time

import numpy as np
import pytest

import kdl_calibration as kc


def test_parts_outlive_the_calibration(robot, measurements, found):
    own = kc.calibrate(robot, measurements)
    arm, covariance, doubts, accuracy = own.arm, own.covariance, own.remarks, own.accuracy.train.after
    joint_values = own.measurements.joint_values
    compensator = kc.Compensator(own)
    del own
    gc.collect()
    np.testing.assert_array_equal(covariance, found.covariance)
    np.testing.assert_array_equal(arm.predict(joint_values, "A").position, found.predict(joint_values, "A").position)
    assert [str(doubt) for doubt in doubts] == [str(doubt) for doubt in found.remarks]
    assert accuracy.rms == found.accuracy.train.after.rms
    assert (compensator.solve(joint_values).position_error < 1e-9).all()


def test_views_outlive_their_measurements(robot):
    m, _ = kc.simulate(robot, configurations=1000, seed=3)
    view, copy = m.joint_values, m.joint_values.copy()
    del m
    gc.collect()
    np.testing.assert_array_equal(view, copy)


def test_any_number_of_threads_gives_the_same(found, random):
    q = random.uniform(-1.0, 1.0, (2000, 6))
    alone = found.predict(q, "B", threads=1)
    for threads in (2, 5):
        for own, other in zip(found.predict(q, "B", threads=threads), alone):
            np.testing.assert_array_equal(own, other)


def test_python_threads_share_an_arm(found, random):
    q = random.uniform(-1.0, 1.0, (8, 500, 6))
    alone = [found.predict(part, "B").position for part in q]
    results = [None] * 8

    def work(i):
        for _ in range(3):
            results[i] = found.predict(q[i], "B").position

    threads = [threading.Thread(target=work, args=(i,)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for own, other in zip(results, alone):
        np.testing.assert_array_equal(own, other)


def test_other_threads_run_during_a_calibration(robot):
    """The lock is free: a thread of Python is called while the calibration waits for it."""
    m, _ = kc.simulate(robot, configurations=30, noise=1e-5)
    asked, answered = threading.Event(), threading.Event()

    def answer():
        asked.wait()
        answered.set()

    thread = threading.Thread(target=answer)
    thread.start()
    seen = []

    def progress(stage, done, of):
        asked.set()
        seen.append((stage, done, of, answered.wait(timeout=60.0)))

    kc.calibrate(robot, m, progress=progress)
    thread.join()
    assert all(entry[3] for entry in seen)
    assert all(0 <= done <= of for _, done, of, _ in seen)


def test_an_exception_of_progress_ends_the_work(robot, measurements):
    calls = []

    def progress(stage, done, of):
        calls.append(stage)
        raise KeyError("enough")

    with pytest.raises(KeyError, match="enough"):
        kc.calibrate(robot, measurements, progress=progress)
    assert len(calls) == 1
    with pytest.raises(ZeroDivisionError):
        kc.plan(robot, progress=lambda share: 1 / 0)


def test_ctrl_c_stops_a_calibration(robot, measurements):
    all_calls, calls = [], []
    kc.calibrate(robot, measurements, progress=lambda *call: all_calls.append(call))

    def progress(*call):
        if not calls:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.2)  # the thread that waits looks for signals meanwhile
        calls.append(call)

    with pytest.raises(KeyboardInterrupt):
        kc.calibrate(robot, measurements, progress=progress)
    assert len(calls) < len(all_calls)


def test_ctrl_c_stops_predictions(found):
    q = np.zeros((3_000_000, 6))
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        found.predict(q, "A")
    timer.join()


def test_a_signal_at_the_end_of_work_arrives(robot):
    """A validation that tries no readings never looks for it."""
    m, _ = kc.simulate(robot, configurations=1000)
    for _ in range(8):  # until it lasts for long enough
        start = time.monotonic()
        kc.validate(robot, m, diagnosis={"try_readings": False})
        lasted = time.monotonic() - start
        if lasted > 0.5:
            break
        m, _ = kc.simulate(robot, configurations=2 * len(m.configurations))
    timer = threading.Timer(0.4 * lasted, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        kc.validate(robot, m, diagnosis={"try_readings": False})
        time.sleep(10.0)  # a signal that comes too late is no defect
    timer.join()


def test_progress_of_a_validation(robot, measurements):
    """Other readings of the joints are tried, because nominal geometry leaves a millimetre."""
    calls = []
    kc.validate(robot, measurements, progress=lambda *call: calls.append(call))
    assert {stage for stage, _, _ in calls} == {"trying other readings of the joints"}
    assert sorted(done for _, done, _ in calls) == list(range(calls[0][2] + 1))
    stopped = []

    def interrupt(*call):
        if not stopped:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.2)
        stopped.append(call)

    with pytest.raises(KeyboardInterrupt):
        kc.validate(robot, measurements, progress=interrupt)
    assert len(stopped) < len(calls)
    with pytest.raises(ZeroDivisionError):
        kc.validate(robot, measurements, progress=lambda *call: 1 / 0)


def test_a_signal_comes_before_the_error_of_the_work(robot):
    m, _ = kc.simulate(robot, configurations=40, noise=3e-5)

    def slow(q):
        if len(q) > 1:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.2)
            return q[:3, 0]
        return q[:, 0]

    with pytest.raises(KeyboardInterrupt):
        kc.calibrate(robot, m, effects={"own": {"w": {"joint": "joint_3", "function": slow}}})
