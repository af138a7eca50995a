"""One harness for every benchmark of clvox."""
