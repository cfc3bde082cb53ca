from .csv import write_csv as write_csv
from .job import Job as Job
from .place import ResultPlace as ResultPlace, outputs_of as outputs_of
from .strain_table import STRAIN_FILE as STRAIN_FILE, write_strain_table as write_strain_table
