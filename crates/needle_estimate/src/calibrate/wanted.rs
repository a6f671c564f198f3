//! A key that a calibration identifies.

/// A key to identify, with bounds.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// Dotted path.
    pub key: String,
    /// Least and largest value, in the key's unit; `None`: the key's own range.
    pub bounds: Option<[f64; 2]>,
}

impl Wanted {
    /// Parses `KEY` or `KEY=LOW..HIGH`.
    ///
    /// # Errors
    /// What is wrong with the bounds.
    pub fn parse(text: &str) -> Result<Self, String> {
        let Some((key, bounds)) = text.split_once('=') else {
            return Ok(Self { key: text.trim().to_owned(), bounds: None });
        };
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|x| x.is_finite());
        let both = bounds.split_once("..").and_then(|(low, high)| Some([number(low)?, number(high)?]));
        let bounds = both.ok_or_else(|| "bounds are two numbers, as in KEY=0.2..0.8".to_owned())?;
        Ok(Self { key: key.trim().to_owned(), bounds: Some(bounds) })
    }
}
