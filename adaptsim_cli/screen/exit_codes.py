"""The exit code of each documented error. Any other error is a defect of the program."""

from __future__ import annotations


def documented_errors() -> tuple[type[BaseException], ...]:
    """The errors that `run` turns into a message and an exit code; any other error is a defect."""
    return tuple(kind for kind, _ in _codes())


def exit_code(error: BaseException) -> int:
    """The documented exit code of one of the `documented_errors`."""
    return next(code for kind, code in _codes() if isinstance(error, kind))


def _codes() -> tuple[tuple[type[BaseException], int], ...]:
    import calib.errors
    import hw.errors
    import perception.errors
    import sim.errors
    from adaptsim_cli import errors

    return (
        (errors.UsageError, 2),
        (sim.errors.UnknownName, 2),
        (sim.errors.NoHardware, 2),
        (sim.errors.MomentsMissing, 2),
        (sim.errors.TaskError, 2),
        (sim.errors.WorldError, 2),
        (sim.errors.OutOfRange, 2),
        (sim.errors.ObjectError, 2),
        (errors.PreflightFailed, 3),
        (hw.errors.DeviceUnavailable, 3),
        (hw.errors.BalanceError, 3),
        (hw.errors.HandError, 3),
        (sim.errors.ClusterUnavailable, 3),
        (sim.errors.ExtraMissing, 3),
        (calib.errors.ViewFolderError, 8),
        (calib.errors.CalibrationError, 3),
        (hw.errors.Rehearsed, 7),
        (hw.errors.MotionRefused, 4),
        (sim.errors.NotExecutable, 4),
        (hw.errors.StoppedByPedal, 7),
        (hw.errors.ArmFault, 5),
        (hw.errors.CameraError, 6),
        (perception.errors.PerceptionError, 6),
        (errors.StoppedByOperator, 7),
        (errors.AnswerAwaited, 7),
        (errors.AnswerRefused, 8),
        (errors.SessionError, 8),
        (sim.errors.RecordingsRefused, 8),
        (sim.errors.DatasetError, 8),
        (sim.errors.CheckpointError, 8),
        (sim.errors.SimError, 1),  # any other failure of a simulation
        (OSError, 8),  # a full or write-protected disk
        (errors.Interrupted, 130),
        (KeyboardInterrupt, 130),
    )
