//! What JPEG does to a grey picture: blocks of 8 × 8, the DCT and its quantisation (ITU-T T.81, table K.1).

const LUMA: [f64; 64] = [
    16., 11., 10., 16., 24., 40., 51., 61., 12., 12., 14., 19., 26., 58., 60., 55., 14., 13., 16.,
    24., 40., 57., 69., 56., 14., 17., 22., 29., 51., 87., 80., 62., 18., 22., 37., 56., 68., 109.,
    103., 77., 24., 35., 55., 64., 81., 104., 113., 92., 49., 64., 78., 87., 103., 121., 120.,
    101., 72., 92., 95., 98., 112., 100., 103., 99.,
];

/// Compresses and decompresses with libjpeg's scale of quality.
pub fn through(pixels: &mut [u8], w: usize, h: usize, quality: f64) {
    let scale = if quality < 50.0 {
        5000.0 / quality
    } else {
        200.0 - 2.0 * quality
    } / 100.0;
    let steps = LUMA.map(|q| (q * scale).round().clamp(1.0, 255.0));
    let mut basis = [[0.0f64; 8]; 8];
    for (k, row) in basis.iter_mut().enumerate() {
        for (n, v) in row.iter_mut().enumerate() {
            let norm = if k == 0 { 0.125f64 } else { 0.25 }.sqrt();
            *v = norm * ((n as f64 + 0.5) * k as f64 * std::f64::consts::PI / 8.0).cos();
        }
    }
    for r0 in (0..h).step_by(8) {
        for c0 in (0..w).step_by(8) {
            let at = |x: usize, y: usize| (r0 + y).min(h - 1) * w + (c0 + x).min(w - 1);
            let mut block = [[0.0; 8]; 8];
            for (y, row) in block.iter_mut().enumerate() {
                for (x, v) in row.iter_mut().enumerate() {
                    *v = f64::from(pixels[at(x, y)]) - 128.0;
                }
            }
            // B X Bᵀ, quantised, and back.
            let half = |m: &[[f64; 8]; 8], back: bool| -> [[f64; 8]; 8] {
                std::array::from_fn(|k| {
                    std::array::from_fn(|x| {
                        (0..8)
                            .map(|y| if back { basis[y][k] } else { basis[k][y] } * m[y][x])
                            .sum()
                    })
                })
            };
            let turn = |m: [[f64; 8]; 8]| -> [[f64; 8]; 8] {
                std::array::from_fn(|y| std::array::from_fn(|x| m[x][y]))
            };
            let mut freq = turn(half(&turn(half(&block, false)), false));
            for (y, row) in freq.iter_mut().enumerate() {
                for (x, v) in row.iter_mut().enumerate() {
                    *v = (*v / steps[y * 8 + x]).round() * steps[y * 8 + x];
                }
            }
            let out = turn(half(&turn(half(&freq, true)), true));
            for y in 0..8.min(h - r0) {
                for x in 0..8.min(w - c0) {
                    pixels[(r0 + y) * w + c0 + x] =
                        (out[y][x] + 128.0).round().clamp(0.0, 255.0) as u8;
                }
            }
        }
    }
}
