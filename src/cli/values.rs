//! Values as people write them: shares, sizes, durations, file names.

use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};

use crate::basis::Basis;
use crate::links::points::Operator;

/// Parses "2%" or "0.02" as a share within (0, 1].
pub fn share(text: &str) -> Result<f64, String> {
    let trimmed = text.trim();
    let (digits, divisor) = trimmed.strip_suffix('%').map_or((trimmed, 1.0), |digits| (digits, 100.0));
    let value: f64 = digits.trim().parse().map_err(|_| "expected a share such as 2% or 0.02".to_owned())?;
    // Parsing what the user sees, "0.02" for "2%", makes both the same number.
    let value = if divisor == 1.0 { value } else { (value / divisor * 1e15).round() / 1e15 };
    if value > 0.0 && value <= 1.0 {
        Ok(value)
    } else {
        Err("expected more than 0 and at most 100%".to_owned())
    }
}

/// Parses "4GiB", "4G" (both binary), "500MB" (decimal) or plain bytes.
pub fn bytes(text: &str) -> Result<u64, String> {
    let factor = |unit: &str| match unit.trim() {
        "" | "b" => Some(1.0),
        "k" | "kib" => Some(1024.0),
        "m" | "mib" => Some(1024f64.powi(2)),
        "g" | "gib" => Some(1024f64.powi(3)),
        "t" | "tib" => Some(1024f64.powi(4)),
        "kb" => Some(1e3),
        "mb" => Some(1e6),
        "gb" => Some(1e9),
        "tb" => Some(1e12),
        _ => None,
    };
    let size = scaled(text, factor).filter(|&size| size >= 1.0);
    size.map(|size| size as u64).ok_or_else(|| "expected a size such as 4GiB, 500MB or 1000000".to_owned())
}

/// Parses a number of things, as 2000000, 500k or 2M (decimal).
pub fn count(text: &str) -> Result<u64, String> {
    let factor = |unit: &str| match unit {
        "" => Some(1.0),
        "k" => Some(1e3),
        "m" => Some(1e6),
        "g" => Some(1e9),
        _ => None,
    };
    let count = scaled(text, factor);
    count.map(|count| count as u64).ok_or_else(|| "expected a number such as 2000000, 500k or 2M".to_owned())
}

/// Digits and the factor of the unit behind them, which is asked for in lower case; below 2^63.
fn scaled(text: &str, factor: impl Fn(&str) -> Option<f64>) -> Option<f64> {
    let text = text.trim();
    let split = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (digits, unit) = text.split_at(split);
    let value: f64 = digits.parse().ok()?;
    Some(value * factor(&unit.to_ascii_lowercase())?).filter(|&product| product < 2f64.powi(63))
}

/// A parser of the bases' names.
pub fn basis() -> impl TypedValueParser<Value = Basis> {
    PossibleValuesParser::new(Basis::ALL.map(Basis::name)).try_map(|name| name.parse::<Basis>())
}

/// A parser of the operators' names.
pub fn operator() -> impl TypedValueParser<Value = Operator> {
    PossibleValuesParser::new(Operator::ALL.map(Operator::name)).try_map(|name| name.parse::<Operator>())
}

/// A parser of file names that end in one of `endings`.
pub fn file_ending(endings: &'static [&'static str]) -> impl TypedValueParser<Value = PathBuf> {
    clap::builder::PathBufValueParser::new().try_map(move |path| {
        let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match ending {
            Some(ending) if endings.contains(&ending.as_str()) => Ok(path),
            _ => Err(format!("expected a file name that ends in .{}", endings.join(" or ."))),
        }
    })
}

/// Bytes for people: "3.2 GiB".
pub fn show_bytes(bytes: u64) -> String {
    let mut value = bytes as f64;
    let mut unit = "B";
    for larger in ["KiB", "MiB", "GiB", "TiB"] {
        if value < 1024.0 {
            break;
        }
        value /= 1024.0;
        unit = larger;
    }
    if unit == "B" || value >= 100.0 { format!("{value:.0} {unit}") } else { format!("{value:.1} {unit}") }
}

/// Seconds for people: "0.42 s", "12 s", "3 min 05 s", "2 h 10 min".
pub fn show_seconds(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    match whole {
        0..10 => format!("{seconds:.2} s"),
        10..60 => format!("{whole} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole % 3600 / 60),
    }
}

/// A count with thin groups of three digits: "1 234 567".
pub fn show_count(count: u64) -> String {
    let digits = count.to_string();
    let mut shown = String::new();
    for (k, digit) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            shown.push(' ');
        }
        shown.push(digit);
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_percent_or_plain() {
        assert_eq!((share("2%"), share("0.02"), share(" 0.5 %")), (Ok(0.02), Ok(0.02), Ok(0.005)));
        for hundredths in 1..=10_000 {
            let (percent, plain) =
                (format!("{}%", f64::from(hundredths) / 100.0), f64::from(hundredths) / 1e4);
            assert_eq!(share(&percent), Ok(plain), "{percent}");
        }
        for bad in ["0", "-1%", "200%", "nan", "inf", "", "%", "two"] {
            assert!(share(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn sizes_know_both_kinds_of_units() {
        assert_eq!((bytes("4GiB"), bytes("500MB"), bytes("123")), (Ok(4 << 30), Ok(500_000_000), Ok(123)));
        assert_eq!((bytes("1.5 G"), bytes("2k")), (Ok(3 << 29), Ok(2048)));
        for bad in ["", "GiB", "4 GiBs", "-1", "0", "1e99", "99999999999TiB", "1.2.3"] {
            assert!(bytes(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn counts_are_decimal() {
        assert_eq!(
            (count("2000000"), count("500k"), count("1.5M")),
            (Ok(2_000_000), Ok(500_000), Ok(1_500_000))
        );
        assert_eq!((count("0"), count(" 2G ")), (Ok(0), Ok(2_000_000_000)));
        for bad in ["", "k", "2 k", "2kB", "-1", "1e3", "99999999999G", "1.2.3"] {
            assert!(count(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn numbers_read_well() {
        assert_eq!((show_bytes(1023).as_str(), show_bytes(3 << 29).as_str()), ("1023 B", "1.5 GiB"));
        assert_eq!((show_seconds(0.418).as_str(), show_seconds(185.2).as_str()), ("0.42 s", "3 min 05 s"));
        assert_eq!((show_count(1_234_567).as_str(), show_count(12).as_str()), ("1 234 567", "12"));
    }
}
