//! Point spread: a separable, sampled Gaussian.

/// Normalised weights -radius ..= radius, radius 4 sigma; a sigma below 0.05 px is no blur.
///
/// Sampled, not integrated: the pixel's own box is already in the picture. Symmetric, so it moves no centre.
pub(super) fn kernel(sigma_px: f64) -> Vec<f32> {
    let radius = if sigma_px < 0.05 {
        0
    } else {
        (4.0 * sigma_px).ceil() as i32
    };
    let weight = |k: i32| {
        if radius == 0 {
            1.0
        } else {
            (-0.5 * (f64::from(k) / sigma_px).powi(2)).exp()
        }
    };
    let sum: f64 = (-radius..=radius).map(weight).sum();
    (-radius..=radius)
        .map(|k| (weight(k) / sum) as f32)
        .collect()
}

/// Blurs a column-major picture (`rows` per column) down its columns, then across; drops
/// `kernel.len() / 2` columns at either side, which only served as surroundings.
pub(super) fn blur(picture: &[f32], rows: usize, kernel: &[f32]) -> Vec<f32> {
    let radius = kernel.len() / 2;
    if radius == 0 {
        return picture.to_vec();
    }
    let mut down = vec![0.0f32; picture.len()];
    for (out, column) in down.chunks_exact_mut(rows).zip(picture.chunks_exact(rows)) {
        for (k, &weight) in kernel.iter().enumerate() {
            // out[i] += weight * column[i + k - radius], inside the column
            let (from, to) = if k < radius {
                (0, radius - k)
            } else {
                (k - radius, 0)
            };
            let n = rows.saturating_sub(from.max(to));
            for (o, c) in out[to.min(rows)..]
                .iter_mut()
                .zip(&column[from.min(rows)..])
                .take(n)
            {
                *o += weight * c;
            }
        }
    }
    let columns = picture.len() / rows;
    let mut across = vec![0.0f32; rows * columns.saturating_sub(2 * radius)];
    for (i, out) in across.chunks_exact_mut(rows).enumerate() {
        for (k, &weight) in kernel.iter().enumerate() {
            let source = &down[(i + k) * rows..(i + k + 1) * rows];
            for (o, s) in out.iter_mut().zip(source) {
                *o += weight * s;
            }
        }
    }
    across
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_becomes_a_gaussian_of_the_same_sum_and_centre() {
        let k = kernel(0.7);
        let radius = k.len() / 2;
        let (rows, columns) = (21, 15 + 2 * radius);
        let mut picture = vec![0.0f32; rows * columns];
        picture[(7 + radius) * rows + 10] = 100.0;
        let blurred = blur(&picture, rows, &k);
        let sum: f32 = blurred.iter().sum();
        assert!((sum - 100.0).abs() < 1e-3, "{sum}");
        let mean_row: f32 = blurred
            .iter()
            .enumerate()
            .map(|(i, v)| (i % rows) as f32 * v)
            .sum::<f32>()
            / sum;
        let mean_col: f32 = blurred
            .iter()
            .enumerate()
            .map(|(i, v)| (i / rows) as f32 * v)
            .sum::<f32>()
            / sum;
        assert!((mean_row - 10.0).abs() < 1e-5 && (mean_col - 7.0).abs() < 1e-5);
        let var: f32 = blurred
            .iter()
            .enumerate()
            .map(|(i, v)| ((i % rows) as f32 - mean_row).powi(2) * v)
            .sum::<f32>()
            / sum;
        assert!((var - 0.49).abs() < 0.005, "{var}");
    }

    #[test]
    fn no_blur_changes_nothing() {
        assert_eq!(kernel(0.0), vec![1.0]);
        assert_eq!(
            blur(&[1.0, 2.0, 3.0, 4.0], 2, &kernel(0.0)),
            vec![1.0, 2.0, 3.0, 4.0]
        );
    }
}
