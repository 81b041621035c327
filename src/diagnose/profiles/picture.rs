//! Residuals over the image.
