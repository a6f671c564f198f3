//! TOML text to raw values: every key looked up in the registry, every error with its line.

use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use super::keys::{self, SECTIONS};
use super::values::Values;
use super::{SceneError, Value, uncertainty};

/// Longest piece of a file that a message quotes.
const QUOTED: usize = 60;

/// Reads and checks every key of a scene file.
pub(super) fn parse(text: &str, origin: &str) -> Result<Values, SceneError> {
    let source = Source { text, origin, lines: text.match_indices('\n').map(|(at, _)| at + 1).collect() };
    let document = DeTable::parse(text).map_err(|error| source.syntax(&error))?;
    let mut values = Values::new(origin);
    for (name, value) in in_file_order(document.get_ref()) {
        match (name, value.get_ref()) {
            ("targets", DeValue::Array(list)) => source.targets(list, &mut values)?,
            ("materials", DeValue::Table(table)) => source.materials(table, &mut values)?,
            ("regions", DeValue::Array(list)) => source.regions(list, &mut values)?,
            (uncertainty::SECTION, DeValue::Table(table)) => source.uncertainty(table, &mut values)?,
            (section, DeValue::Table(table))
                if SECTIONS.contains(&section) && !["targets", "regions"].contains(&section) =>
            {
                values.name_section(section);
                source.section(section, table, &mut values)?;
            }
            (section, _) if SECTIONS.contains(&section) || section == uncertainty::SECTION => {
                return Err(source.not_a_section(section, value));
            }
            _ => source.leaf(name, value, &mut values)?,
        }
    }
    Ok(values)
}

/// The file's text, to turn byte offsets into places.
struct Source<'a> {
    text: &'a str,
    origin: &'a str,
    /// Where each line but the first begins, in bytes.
    lines: Vec<usize>,
}

impl Source<'_> {
    fn section(&self, path: &str, table: &DeTable<'_>, values: &mut Values) -> Result<(), SceneError> {
        for (name, value) in in_file_order(table) {
            self.leaf(&format!("{path}.{name}"), value, values)?;
        }
        Ok(())
    }

    fn targets(&self, list: &DeArray<'_>, values: &mut Values) -> Result<(), SceneError> {
        values.name_section("targets");
        for (i, element) in list.iter().enumerate() {
            let DeValue::Table(table) = element.get_ref() else { return Err(self.not_a_section("targets", element)) };
            if table.is_empty() {
                // An empty element has no key to be missed by; the name is what it lacks first.
                return Err(SceneError::Missing {
                    place: self.place(element),
                    key: format!("targets.{i}.name"),
                    allowed: "text".to_owned(),
                    because: String::new(),
                });
            }
            self.section(&format!("targets.{i}"), table, values)?;
        }
        Ok(())
    }

    fn materials(&self, table: &DeTable<'_>, values: &mut Values) -> Result<(), SceneError> {
        for (name, value) in in_file_order(table) {
            let DeValue::Table(table) = value.get_ref() else {
                return Err(self.not_a_section("materials", value));
            };
            self.check_name("materials", name, &self.place(value))?;
            values.name_section("materials");
            values.name_element("materials", name);
            self.section(&format!("materials.{name}"), table, values)?;
        }
        Ok(())
    }

    fn regions(&self, list: &DeArray<'_>, values: &mut Values) -> Result<(), SceneError> {
        for (i, element) in list.iter().enumerate() {
            let DeValue::Table(table) = element.get_ref() else { return Err(self.not_a_section("regions", element)) };
            let name = table.iter().find(|(key, _)| &**key.get_ref() == "name").map(|(_, value)| value);
            let Some(DeValue::String(name)) = name.map(Spanned::get_ref) else {
                return Err(SceneError::Missing {
                    place: self.place(element),
                    key: format!("regions.{i}.name"),
                    allowed: "text".to_owned(),
                    because: String::new(),
                });
            };
            self.check_name("regions", name, &self.place(element))?;
            if values.names("regions").any(|known| known == &**name) {
                return Err(SceneError::Inconsistent {
                    place: self.place(element),
                    key: format!("regions.{name}.name"),
                    value: format!("\"{name}\""),
                    reason: "two regions have this name".to_owned(),
                });
            }
            self.section(&format!("regions.{name}"), table, values)?;
        }
        Ok(())
    }

    fn uncertainty(&self, table: &DeTable<'_>, values: &mut Values) -> Result<(), SceneError> {
        for (name, value) in in_file_order(table) {
            for one in uncertainty::read(name, value.get_ref(), &self.quote(value), &self.place(value))? {
                values.put_prior(one);
            }
        }
        Ok(())
    }

    /// A name that is part of a dotted path.
    fn check_name(&self, section: &str, name: &str, place: &str) -> Result<(), SceneError> {
        let plain = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
        if !name.is_empty() && name.chars().all(plain) {
            return Ok(());
        }
        Err(SceneError::Inconsistent {
            place: place.to_owned(),
            key: format!("{section}.{name}"),
            value: format!("\"{}\"", shortened(name)),
            reason: "a name takes letters, digits, _ and -: it is part of paths such as regions.skin.to_depth_m"
                .to_owned(),
        })
    }

    fn leaf(&self, path: &str, value: &Spanned<DeValue<'_>>, values: &mut Values) -> Result<(), SceneError> {
        let place = self.place(value);
        let key = keys::require(path, &self.quote(value), &place)?;
        let raw = to_value(value.get_ref()).ok_or_else(|| SceneError::WrongType {
            place: place.clone(),
            key: path.to_owned(),
            value: self.quote(value),
            found: kind_of(value.get_ref()),
            allowed: key.allowed(),
        })?;
        values.insert(path, key.check(&raw, path, &place)?, place);
        Ok(())
    }

    fn not_a_section(&self, section: &str, value: &Spanned<DeValue<'_>>) -> SceneError {
        SceneError::WrongType {
            place: self.place(value),
            key: section.to_owned(),
            value: self.quote(value),
            found: kind_of(value.get_ref()),
            allowed: match section {
                "targets" | "regions" => format!("tables [[{section}]]"),
                "materials" => "tables [materials.NAME]".to_owned(),
                _ => format!("a table [{section}]"),
            },
        }
    }

    fn syntax(&self, error: &toml::de::Error) -> SceneError {
        let at = error.span().map_or(0, |span| span.start);
        let (line, column) = self.line_column(at);
        let excerpt = self.text.lines().nth(line - 1).map(str::trim).unwrap_or_default();
        SceneError::Syntax {
            place: format!("{}:{line}:{column}", self.origin),
            message: error.message().replace('\n', ", "),
            excerpt: if excerpt.is_empty() { String::new() } else { format!(": `{}`", shortened(excerpt)) },
        }
    }

    fn place<T>(&self, spanned: &Spanned<T>) -> String {
        format!("{}:{}", self.origin, self.line_column(spanned.span().start).0)
    }

    /// Line and column of a byte offset, both from 1.
    fn line_column(&self, offset: usize) -> (usize, usize) {
        let offset = offset.min(self.text.len());
        let before = self.lines.partition_point(|&start| start <= offset);
        let start = before.checked_sub(1).map_or(0, |last| self.lines[last]);
        (before + 1, offset - start + 1)
    }

    /// The value as the file has it, shortened.
    fn quote<T>(&self, spanned: &Spanned<T>) -> String {
        shortened(self.text.get(spanned.span()).unwrap_or_default())
    }
}

/// One line of at most [`QUOTED`] characters.
fn shortened(text: &str) -> String {
    let line: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(QUOTED + 1).collect();
    if line.chars().count() <= QUOTED { line } else { line.chars().take(QUOTED).chain("...".chars()).collect() }
}

/// The entries of a table as the file has them, so that the first error is the first in the file.
fn in_file_order<'t, 'i>(table: &'t DeTable<'i>) -> Vec<(&'t str, &'t Spanned<DeValue<'i>>)> {
    let mut entries: Vec<_> = table.iter().map(|(key, value)| (key.span().start, &**key.get_ref(), value)).collect();
    entries.sort_by_key(|&(start, ..)| start);
    entries.into_iter().map(|(_, name, value)| (name, value)).collect()
}

fn to_value(value: &DeValue<'_>) -> Option<Value> {
    match value {
        DeValue::String(text) => Some(Value::Text(text.to_string())),
        DeValue::Integer(digits) => i64::from_str_radix(digits.as_str(), digits.radix()).ok().map(Value::Integer),
        DeValue::Float(digits) => digits.as_str().parse().ok().map(Value::Real),
        DeValue::Boolean(yes) => Some(Value::Boolean(*yes)),
        DeValue::Array(list) => numbers(list),
        DeValue::Datetime(_) | DeValue::Table(_) => None,
    }
}

fn numbers(list: &DeArray<'_>) -> Option<Value> {
    let numbers: Vec<f64> = list.iter().map(|x| to_value(x.get_ref())?.as_real()).collect::<Option<_>>()?;
    Some(Value::of_numbers(numbers))
}

const fn kind_of(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "text",
        DeValue::Integer(_) => "a whole number",
        DeValue::Float(_) => "a number",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date or time",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}
