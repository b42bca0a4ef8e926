//! Radiosity on `farfield`.
