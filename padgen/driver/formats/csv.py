"""The driver frequency table as CSV, and with a tuning that of the print as measured."""

from padgen.core.files import OutputFolder
from padgen.driver.formats import DriveJob
from padgen.driver.tables import drive_csv
from padgen.measured.tuned_folder import tuned_drive_csv

__all__ = ["FILE", "MADE_OF", "ORDER", "write"]

ORDER, MADE_OF, FILE = 0, "plan", "drive.csv"


def write(out: OutputFolder, job: DriveJob) -> None:
    """Add the table, and with a tuning the table of the print as measured."""
    out.write(FILE, drive_csv(job.plan))
    if job.request.tuning is not None:
        out.write("drive-tuned.csv", tuned_drive_csv(job.plan, job.request.tuning))
