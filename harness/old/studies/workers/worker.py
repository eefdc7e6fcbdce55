"""Answers calls in a worker process."""

import importlib
from contextlib import suppress
from multiprocessing.connection import Connection

from harness.core.errors import in_one_line


def serve(connection: Connection, modules: str) -> None:
    """Answer calls from a pipe until the pipe is closed or the parent process ends.

    The first message is None if all imports, including ``modules``, succeeded; otherwise it is the
    error.  The answer to a call is (True, result) or (False, reason why there is no result).
    """
    # A broken pipe is not an error, because it means that the parent has ended.
    with suppress(EOFError, OSError):
        try:
            for module in modules.split(","):
                importlib.import_module(module)
        except Exception as error:
            connection.send(in_one_line(error))
            return
        connection.send(None)
        while True:
            function, argument = connection.recv()
            try:
                answer = (True, function(argument))
            except BaseException as error:  # a strategy may call sys.exit
                answer = (False, f"{type(error).__name__}: {error}")
            connection.send(answer)
