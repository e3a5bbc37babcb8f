"""Named errors and warnings: each message says what was expected, what came, and what to do."""


class PartitionError(Exception):
    """Base of every error that this library raises."""


class InputError(PartitionError, ValueError):
    """An argument has the wrong type, shape, range or a value that is not finite."""


class CallError(InputError):
    """Arguments of the command line that no command takes."""


class MeshError(InputError):
    """A mesh or FE model that cannot be used: wrong elements, inconsistent matrices, several parts."""


class InvertedElementsError(MeshError):
    """Elements that curved sides or a wrong order of nodes turn inside out, or that have no volume."""


class LockingError(MeshError):
    """A nearly incompressible material in linear elements, which lock: they are far too stiff."""


class EmptyRegionError(InputError):
    """An impact region or contact patch that holds no nodes, or lies outside the body."""


class FrequencyRangeError(InputError):
    """A frequency that the mesh or the samples of a signal do not resolve, or below which there is no mode."""


class StepSizeError(InputError):
    """An explicit step above the stability limit of the assembled model."""


class PenetrationError(InputError):
    """Two bodies that overlap where they are first placed."""


class IndefiniteMatrixError(PartitionError, ArithmeticError):
    """A matrix that must be symmetric positive definite and is not."""


class ModeAccuracyError(PartitionError, ArithmeticError):
    """Eigenmodes that converged but are not those of the stiffness matrix: the factors have lost accuracy."""


class ComplementarityError(PartitionError, ArithmeticError):
    """A contact problem whose active set did not settle."""


class RunError(PartitionError, RuntimeError):
    """A run that Exudyn could not start or that was set up inconsistently."""


class CompiledRunError(InputError):
    """A model, or an option, that compiled runs cannot hold; the message lists all reasons."""


class OutputError(PartitionError, OSError):
    """A file that the system could not write: a full disk, or a protected folder; the old file is kept."""


class MemoryLimitError(PartitionError, MemoryError):
    """A model that needs more memory than there is."""


class MissingPackageError(PartitionError, ImportError):
    """An optional package that is not installed."""


class PartitionWarning(UserWarning):
    """Base of every warning of this library."""


class UnitsWarning(PartitionWarning):
    """Numbers that look like a slip of units, such as millimetres with SI materials."""


class MeshQualityWarning(PartitionWarning):
    """A mesh with damaged or badly shaped elements, that misses the volume of its shape, or is coarse for `f_cut`."""


class ContactPatchWarning(PartitionWarning):
    """A contact that reaches the edge of its patch or beyond, never meets it, or misses a corner of it."""


class SelectionWarning(PartitionWarning):
    """A choice of faces by geometry that catches several, where one may be meant."""


class MemoryWarning(PartitionWarning):
    """A model that needs more memory than is free."""


class CacheWarning(PartitionWarning):
    """A cache that cannot be read or written; what it should hold is computed anew."""


class ModelLimitWarning(PartitionWarning):
    """A motion beyond what the model holds for, such as large rotation in an inertial frame."""


class YieldWarning(PartitionWarning):
    """A contact beneath which a body would yield; bodies stay elastic, and real ones do not."""


class ToleranceWarning(PartitionWarning):
    """A tolerance that the mesh does not let a basis reach; the best body is returned."""


class StoppedRunWarning(PartitionWarning):
    """A run that was interrupted or became unstable; its results up to there are kept."""


class FailedRunsWarning(PartitionWarning):
    """Runs of a study that failed; the others are kept, and these are run again when the study is called again."""


class ModeCountWarning(PartitionWarning):
    """Fewer or more modes found in a band than the signs of the pivots count there."""
