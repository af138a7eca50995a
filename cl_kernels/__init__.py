"""OpenCL C sources of clvox: one folder per operation, headers that they share in `common`."""
