"""The driver frequency table as JSON, with the recipe of the current and where every coil lies."""

from padgen.core.files import OutputFolder
from padgen.driver.formats import DriveJob
from padgen.driver.tables import drive_json

__all__ = ["FILE", "MADE_OF", "ORDER", "write"]

ORDER, MADE_OF, FILE = 1, "plan", "drive.json"


def write(out: OutputFolder, job: DriveJob) -> None:
    """Add the table."""
    out.write(FILE, drive_json(job.plan))
