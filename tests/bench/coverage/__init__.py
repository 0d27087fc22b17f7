"""Net coverage of CAD folders, held against a count that shares nothing with the import.

`python -m tests.bench.coverage [FOLDER ...]`; without folders, the boards that lie beside the project.
"""
