"""One module per operation, paired with its kernels; the only callers of the device."""
