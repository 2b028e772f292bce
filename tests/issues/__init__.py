"""One test for each fault found, by name: the file says what used to happen.

A fault that somebody met goes here first: a test that fails as it failed for them, then the change
that ends it, both in one commit. The name is that of the fault, not of the code where it lay, so
that it is found again after the code has moved; the file's docstring says in one or two sentences
what went wrong, for whom. Shared scenes and fakes come from `tests`, real recordings from
`data_dir`.

Faults whose test needs its neighbours' fixtures, or is one case of many, are held there:

- a corner that the picture hides looked like a clock that runs backwards:
  `reconstruct/test_curves.py`, `reconstruct/test_api.py::TestWhatTheDataSay`
- the bound took light to go on beyond a leg's end in view; ends in view were prolonged:
  `reconstruct/test_tips.py`
- a cut footprint's width was not followed by its derivative: `reconstruct/test_footing.py`
- `photon` took pulses with tails, and piled-up ones, for Gaussians: `reconstruct/test_photon.py`
- a vendor's reader made gigabytes of a small file, or never came back:
  `formats/test_vendor_files.py`; a Photon-HDF5 file claimed time stamps without end:
  `formats/test_photon_hdf5.py`
- a campaign lost the recording whose worker was gone, and a script without a guard began itself
  again and again: `batch/test_faults.py`
- real LinoSPAD2 tables as clocks of the twin: `timing/test_edge_tables.py`
"""
