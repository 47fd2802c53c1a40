//! Force to contact angle, with its uncertainty.
