"""Timings beside other libraries: what the published figures are made with.

python -m benchmarks                 # all cases
python -m benchmarks --quick         # each at its smallest size
python -m benchmarks --case solid --save
python -m benchmarks --table         # the table of the results kept in benchmarks/results
"""
