"""Profiles that come to no end by themselves, in every worker of a page that has this folder on ``PYTHONPATH``.

What follows the first answer of a fit then lasts until a test ends it, on a fast machine and on a slow one.
"""

import sys
import time

if "ipmclab.page.jobs.worker" in sys.orig_argv:
    from ipmclab.progress import stage
    from ipmclab.workflows import fitting

    def without_end(fit):
        while True:
            stage("a profile without end", 0.0, 1.0)
            time.sleep(0.02)

    fitting.profile = without_end
