//! Wavelet radiative transfer.
