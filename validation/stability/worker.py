"""A separate process for cases that may crash or hang. Only that case is lost; the next case gets a new process."""

import multiprocessing


class Worker:
    """Calls a function of a module in another process.

    What the function keeps between calls stays in the process. The process is spawned, because threads of the FE code
    do not survive a fork.

    Parameters
    ----------
    limit : float
        Seconds that a call may take.
    function : callable
        Of plain values, of a module's top level.
    start : callable, optional
        Called in each new process, without a limit.
    """

    def __init__(self, limit, function, start=bool):
        self.limit, self.function, self.start, self.process = limit, function, start, None

    def __call__(self, *arguments):
        """Return what the function does, and "", or None, and how the process ended."""
        if self.process is None:
            context = multiprocessing.get_context("spawn")
            self.pipe, theirs = context.Pipe()
            self.process = context.Process(target=_serve, args=(theirs, self.function, self.start), daemon=True)
            self.process.start()
            theirs.close()
            self.pipe.recv()
        try:
            self.pipe.send(arguments)
            if self.pipe.poll(self.limit):
                return self.pipe.recv(), ""
            end = f"not done after {self.limit:g} s"
        except (EOFError, BrokenPipeError, ConnectionResetError):
            self.process.join()
            end = f"crashed, exit code {self.process.exitcode}"
        self.close()
        return None, end

    def close(self):
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.join()
        self.process = None


def _serve(pipe, function, start):
    start()
    pipe.send("ready")
    while True:
        pipe.send(function(*pipe.recv()))
