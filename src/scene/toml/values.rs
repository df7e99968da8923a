//! Values of a scene file, each with its line and key when it is refused.

use std::ops::{Range, RangeInclusive};
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};
use toml::{Spanned, Value};

use super::{Placed, Reader};
use crate::error::{Error, Result, one_line};
use crate::light::Rgb;
use crate::scene::materials::{BRIGHTEST, check_radiance};
use crate::scene::nearest_word;

impl Reader<'_> {
    pub(super) fn line(&self, at: usize) -> usize {
        1 + self.text.as_bytes()[..at.min(self.text.len())].iter().filter(|&&b| b == b'\n').count()
    }

    pub(super) fn refuse(
        &self,
        span: Range<usize>,
        key: &str,
        problem: impl Into<String>,
        remedy: &str,
    ) -> Error {
        Error::input(self.path, format!("line {}, key {key}", self.line(span.start)), problem, remedy)
    }

    /// Turns the TOML reader's complaint into ours; an unknown key is answered with the nearest known one.
    pub(super) fn syntax(&self, error: &toml::de::Error) -> Error {
        let message = error.message();
        let place = error.span().map_or("text".to_string(), |span| format!("line {}", self.line(span.start)));
        if message.starts_with("unknown field") {
            let mut quoted = message.split('`').skip(1).step_by(2);
            let unknown = one_line(quoted.next().unwrap_or_default(), 40);
            let known: Vec<&str> = quoted.collect();
            let remedy = match nearest_word(&unknown, known.iter().copied()) {
                Some(near) => format!("the nearest valid key is `{near}`"),
                None => format!("valid keys are {}", known.join(", ")),
            };
            let place = format!("{place}, key {unknown}");
            return Error::input(self.path, place, format!("unknown key `{unknown}`"), remedy);
        }
        if let Some(missing) = message.strip_prefix("missing field `").and_then(|rest| rest.strip_suffix('`'))
        {
            let problem = format!("the key `{missing}` is missing");
            return Error::input(self.path, place, problem, format!("add {missing} = ..."));
        }
        Error::input(self.path, place, in_our_words(message), "correct the scene file")
    }

    /// The path that a file key means; it must exist.
    pub(super) fn existing(&self, file: &Spanned<String>, key: &str) -> Result<PathBuf> {
        let path = self.path.parent().unwrap_or(Path::new("")).join(file.get_ref());
        if path.is_file() {
            return Ok(path);
        }
        let what = if path.exists() { "is no file" } else { "does not exist" };
        let problem = format!("{} {what}", path.display());
        Err(self.refuse(file.span(), key, problem, "paths are relative to the scene file: correct it"))
    }

    pub(super) fn number(&self, value: &Placed, key: &str) -> Result<f64> {
        let number = match value.get_ref() {
            Value::Float(number) => *number,
            Value::Integer(number) => *number as f64,
            other => {
                let problem = format!("a number is expected, found {}", other.type_str());
                return Err(self.refuse(value.span(), key, problem, "give a number"));
            }
        };
        if number.is_finite() {
            return Ok(number);
        }
        Err(self.refuse(value.span(), key, format!("{number} is not finite"), "give a finite number"))
    }

    pub(super) fn numbers<const N: usize>(&self, value: &Placed, key: &str) -> Result<[f64; N]> {
        let expected = || format!("{N} numbers are expected");
        let remedy = format!("give an array of {N} numbers");
        let Value::Array(array) = value.get_ref() else {
            let problem = format!("{}, found {}", expected(), value.get_ref().type_str());
            return Err(self.refuse(value.span(), key, problem, &remedy));
        };
        if array.len() != N {
            let problem = format!("{}, found {}", expected(), array.len());
            return Err(self.refuse(value.span(), key, problem, &remedy));
        }
        let mut numbers = [0.0; N];
        for (number, entry) in numbers.iter_mut().zip(array) {
            *number = self.number(&Spanned::new(value.span(), entry.clone()), key)?;
        }
        Ok(numbers)
    }

    pub(super) fn vector(&self, value: &Placed, key: &str) -> Result<DVec3> {
        self.numbers(value, key).map(DVec3::from_array)
    }

    pub(super) fn direction(&self, value: &Placed, key: &str) -> Result<Vec3> {
        let vector = self.vector(value, key)?.try_normalize();
        vector.map(DVec3::as_vec3).ok_or_else(|| {
            self.refuse(value.span(), key, "a direction of no length", "give a vector other than zero")
        })
    }

    /// Three channels, or one number for all of them.
    pub(super) fn colour(&self, value: &Placed, key: &str) -> Result<Rgb> {
        match value.get_ref() {
            Value::Float(_) | Value::Integer(_) => {
                self.number(value, key).map(|grey| Rgb::splat(grey as f32))
            }
            _ => self.vector(value, key).map(DVec3::as_vec3),
        }
    }

    pub(super) fn light(&self, value: &Placed, key: &str) -> Result<Rgb> {
        let light = self.colour(value, key)?;
        let remedy = format!("give values from 0 to {BRIGHTEST:e}");
        check_radiance(light).map_err(|problem| self.refuse(value.span(), key, problem, &remedy))?;
        Ok(light)
    }

    pub(super) fn within(
        &self,
        value: &Option<Placed>,
        key: &str,
        default: f64,
        range: RangeInclusive<f64>,
    ) -> Result<f64> {
        let Some(value) = value else { return Ok(default) };
        let number = self.number(value, key)?;
        if range.contains(&number) {
            return Ok(number);
        }
        let remedy = format!("give a value from {} to {}", range.start(), range.end());
        Err(self.refuse(value.span(), key, format!("{number} is out of range"), &remedy))
    }
}

/// The TOML reader's complaint without the names of Rust's types.
fn in_our_words(message: &str) -> String {
    if let Some((number, _)) = message.trim().split_once(" as i128, expected") {
        return format!("{} is too large", number.trim_start_matches("invalid type: "));
    }
    let mut said = message.trim().replace('\n', " ");
    for (theirs, ours) in [
        ("expected i64", "expected an integer"),
        ("expected u32", "expected a whole number"),
        (" as i128", ""),
        ("expected struct MeshTable", "expected a table"),
        ("expected struct TransformTable", "expected a table"),
        ("expected struct SkyTable", "expected a table"),
        ("expected struct LampTable", "expected a table"),
        ("expected struct CameraTable", "expected a table"),
    ] {
        said = said.replace(theirs, ours);
    }
    said
}

/// Levenshtein distance between two short words.
pub fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, &y) in b.iter().enumerate() {
            let change = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = change.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}
