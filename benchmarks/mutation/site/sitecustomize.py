"""In processes that a test starts: the mutant of $MBOT_MUTANT, once its module is loaded."""

import os
from importlib.machinery import SourceFileLoader

if named := os.environ.get("MBOT_MUTANT"):
    from pathlib import Path

    from mutation.operators import Mutant, mutated

    module, function, kind, number, file = named.split("|")
    MUTANT = Mutant(module, function, kind, int(number), 0, Path(file))
    whole = SourceFileLoader.get_code

    def get_code(self, fullname):
        if self.get_filename(fullname) == file:
            return compile(mutated(MUTANT), file, "exec")
        return whole(self, fullname)

    SourceFileLoader.get_code = get_code
