from .cluster import ClusterWorkers as ClusterWorkers
from .local import LocalWorkers as LocalWorkers
from .workers import ThreadWorker as ThreadWorker, Workers as Workers, one_processor as one_processor
