"""What makes a clock: code widths from steady light, delays and response from flats.

- `chain` (`calibrate_timing`): all recordings to one `TimingCalibration`,
  by the steps of `assemble`, in the words of `notes`
- widths: `code_density`, `code_pattern`, `period_end`
- delays: `delays`, `delay_scan`, `shaped_flat`; response: `flat_response`; what of these a flat's
  pulse asks for, by name: `flat_shapes`
"""
