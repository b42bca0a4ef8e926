//! Power-law kernels for `farfield`.
