//! Numbers for tables.

/// Digits that [`significant`] keeps: coefficients are printed beside their standard deviation, which is
/// rarely below a thousandth of them.
const DIGITS: i32 = 5;

/// Five significant digits, plain where that is readable.
pub fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    if value.abs() < 1e-4 {
        return format!("{value:.4e}");
    }
    let places = (DIGITS - 1 - value.abs().log10().floor() as i32).clamp(0, 8) as usize;
    format!("{value:.places$}")
}

/// Three significant digits without trailing zeros, for legends.
pub(crate) fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    if !(1e-4..1e6).contains(&value.abs()) {
        return format!("{value:.2e}");
    }
    let places = (2 - value.abs().log10().floor() as i32).clamp(0, 6) as usize;
    let text = format!("{value:.places$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_five_digits() {
        assert_eq!(significant(-250.0612), "-250.06");
        assert_eq!(significant(-0.0123456), "-0.012346");
        assert_eq!(significant(123456.7), "123457");
        assert_eq!(significant(1.23e-7), "1.2300e-7");
        assert_eq!(significant(0.0), "0");
        assert_eq!(significant(f64::NAN), "NaN");
    }

    #[test]
    fn legends_have_three_digits_and_no_zeros_behind() {
        assert_eq!(short(0.12345), "0.123");
        assert_eq!(short(-2.0), "-2");
        assert_eq!(short(1234.0), "1234");
        assert_eq!(short(3.2e-7), "3.20e-7");
        assert_eq!(short(0.0), "0");
    }
}
