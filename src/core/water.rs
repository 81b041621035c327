//! Refractive index of water from temperature and salinity.

/// Refractive index of water against air at a wavelength.
///
/// Quan & Fry, "Empirical equation for the index of refraction of seawater",
/// Appl. Opt. 34(18):3477-3480 (1995), their Eq. 3; fitted over 0-30 degC, 0-35 g/kg, 400-700 nm,
/// standard deviation 1.5e-5.
///
/// `temperature_c` \[degC\], `salinity_gpkg` \[g/kg\], `wavelength_nm` \[nm\].
/// Returns `None` outside the fitted range.
pub fn refractive_index(temperature_c: f64, salinity_gpkg: f64, wavelength_nm: f64) -> Option<f64> {
    let inside = (0.0..=30.0).contains(&temperature_c)
        && (0.0..=35.0).contains(&salinity_gpkg)
        && (400.0..=700.0).contains(&wavelength_nm);
    if !inside {
        return None;
    }
    let (t, s, l) = (temperature_c, salinity_gpkg, wavelength_nm);
    Some(
        1.31405 + (1.779e-4 - 1.05e-6 * t + 1.6e-8 * t * t) * s - 2.02e-6 * t * t
            + (15.868 + 0.01155 * s - 0.00423 * t) / l
            - 4382.0 / (l * l)
            + 1.1455e6 / (l * l * l),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fresh_and_sea_water_have_the_handbook_values() {
        // CRC handbook: pure water 20 degC, 589.3 nm: 1.33299 against air.
        let fresh = refractive_index(20.0, 0.0, 589.3).unwrap();
        assert!((fresh - 1.33299).abs() < 1e-4, "{fresh}");
        let sea = refractive_index(20.0, 35.0, 589.3).unwrap();
        assert!((sea - fresh - 0.0064).abs() < 3e-4, "{}", sea - fresh);
    }

    #[test]
    fn outside_the_fit_there_is_no_answer() {
        assert_eq!(refractive_index(45.0, 0.0, 532.0), None);
        assert_eq!(refractive_index(20.0, 50.0, 532.0), None);
        assert_eq!(refractive_index(f64::NAN, 0.0, 532.0), None);
    }
}
