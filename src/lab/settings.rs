//! Parameters of a machine that the user may set: `--set duty=0.55`.

use super::LabError;
use upm_core::document::one_of;

/// A parameter of machine `M`, in the unit that its key names.
#[derive(Clone, Copy, Debug)]
pub struct Setting<M> {
    /// Name on the command line, with the unit, such as `period_ms`.
    pub key: &'static str,
    /// Description in one line.
    pub about: &'static str,
    /// Least and largest value within the machine's model, both included.
    pub range: [f64; 2],
    /// Field of the machine that holds it.
    pub field: Field<M>,
}

/// Accessor of a parameter in machine `M`.
#[derive(Clone, Copy, Debug)]
pub enum Field<M> {
    /// A number in SI; the second value is one unit of the key in SI.
    Number(fn(&mut M) -> &mut f64, f64),
    /// A whole number.
    Count(fn(&mut M) -> &mut u32),
}

/// Parameters of a machine, each by its key, its range, one unit of the key in SI (`count` for a whole number), its
/// field and its description.
macro_rules! settings {
    (@ count $($field:ident).+) => { Field::Count(|machine| &mut machine.$($field).+) };
    (@ $unit:tt $($field:ident).+) => { Field::Number(|machine| &mut machine.$($field).+, $unit) };
    ($($key:literal, $range:expr, $unit:tt, $($field:ident).+, $about:literal;)+) => {
        &[$(Setting { key: $key, about: $about, range: $range, field: settings!(@ $unit $($field).+) }),+]
    };
}
pub(super) use settings;

/// Description of a parameter: meaning, default and range.
#[derive(Clone, Debug, PartialEq)]
pub struct SettingInfo {
    /// Name on the command line, with the unit.
    pub key: &'static str,
    /// Description in one line.
    pub about: &'static str,
    /// Default value.
    pub usual: f64,
    /// Least and largest allowed value.
    pub range: [f64; 2],
}

/// Key and `N` numbers of `KEY=NUMBER:...`.
pub(super) fn key_and_numbers<const N: usize>(text: &str) -> Option<(String, [f64; N])> {
    let (key, numbers) = text.split_once('=')?;
    let numbers = numbers.split(':').map(|number| number.trim().parse().ok()).collect::<Option<Vec<f64>>>()?;
    Some((key.trim().to_owned(), numbers.try_into().ok()?))
}

/// Key and value of an assignment as typed on the command line, `duty=0.55`, in the key's unit.
///
/// # Errors
///
/// Another form.
pub(super) fn assignment(text: &str) -> Result<(String, f64), String> {
    let (key, [value]) = key_and_numbers(text).ok_or_else(|| format!("expected KEY=NUMBER, found {text:?}"))?;
    Ok((key, value))
}

impl<M> Setting<M> {
    /// Its value in `machine`, in the key's unit.
    pub fn value(&self, machine: &mut M) -> f64 {
        match self.field {
            Field::Number(of, unit) => *of(machine) / unit,
            Field::Count(of) => f64::from(*of(machine)),
        }
    }

    /// Sets the parameter of `machine` to `value`, in the key's unit.
    ///
    /// # Errors
    ///
    /// A value outside its range, or a fraction for a whole number.
    pub fn set(&self, machine: &mut M, value: f64) -> Result<(), LabError> {
        let ([least, most], is_count) = (self.range, matches!(self.field, Field::Count(_)));
        let is_allowed = (least..=most).contains(&value) && !(is_count && value.fract() != 0.0);
        if !is_allowed {
            let kind = if is_count { "a whole number from " } else { "" };
            return Err(LabError::Setting(format!("{}: expected {kind}{least} to {most}, found {value}", self.key)));
        }
        match self.field {
            Field::Number(of, unit) => *of(machine) = value * unit,
            Field::Count(of) => *of(machine) = value as u32,
        }
        Ok(())
    }
}

/// The parameter called `key`.
///
/// # Errors
/// An unknown name.
pub(super) fn find<'a, M>(settings: &'a [Setting<M>], key: &str) -> Result<&'a Setting<M>, LabError> {
    settings.iter().find(|setting| setting.key == key).ok_or_else(|| {
        let keys: Vec<&str> = settings.iter().map(|setting| setting.key).collect();
        if keys.is_empty() {
            return LabError::Setting(format!("this experiment has no settings, found {key:?}"));
        }
        LabError::Setting(format!("expected {}, found {key:?}", one_of(key, &keys)))
    })
}

/// `machine` with `assignments` made, later ones overriding earlier ones.
///
/// # Errors
///
/// As [`find`] and [`Setting::set`].
pub(super) fn assigned<M: Clone>(
    settings: &[Setting<M>],
    machine: &M,
    assignments: &[(String, f64)],
) -> Result<M, LabError> {
    let mut machine = machine.clone();
    for (key, value) in assignments {
        find(settings, key)?.set(&mut machine, *value)?;
    }
    Ok(machine)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Debug, PartialEq)]
    struct Press {
        stroke_m: f64,
        blows: u32,
    }

    const SETTINGS: &[Setting<Press>] = settings! {
        "stroke_mm", [0.5, 20.0], 1e-3, stroke_m, "";
        "blows", [1.0, 9.0], count, blows, "";
    };
    const PRESS: Press = Press { stroke_m: 0.01, blows: 2 };

    fn set(texts: &[&str]) -> Result<Press, String> {
        let assignments: Result<Vec<_>, String> = texts.iter().map(|text| assignment(text)).collect();
        assigned(SETTINGS, &PRESS, &assignments?).map_err(|fault| fault.to_string())
    }

    #[test]
    fn values_are_set_in_the_units_of_their_keys() {
        assert_eq!(set(&["stroke_mm=4", "blows=3"]), Ok(Press { stroke_m: 0.004, blows: 3 }));
        assert_eq!(set(&["blows = 3", "blows=4"]).map(|press| press.blows), Ok(4), "the later one");
        let usual: Vec<f64> = SETTINGS.iter().map(|setting| setting.value(&mut PRESS.clone())).collect();
        assert_eq!(usual, [10.0, 2.0]);
    }
}
