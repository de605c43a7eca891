//! Settings as flags of the command line.

use std::sync::OnceLock;

use clap::{Arg, ArgAction, ArgMatches, Command};

use super::table::{Field, Kind, Value};
use super::{Place, Settings};

/// The settings that were given on the command line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SettingFlags(Vec<(Place, Value)>);

/// A setting with the texts of its flag.
struct Flag {
    place: Place,
    field: &'static Field,
    /// Without the leading hyphens.
    name: String,
    /// What turns a switch off.
    no: String,
    help: String,
    heading: String,
    default: Value,
}

impl SettingFlags {
    /// Replaces what was given.
    pub fn apply(&self, settings: &mut Settings) {
        for (place, value) in &self.0 {
            settings.set(*place, *value);
        }
    }
}

/// `shadow.cascades` as `shadow-cascades`; `shadow.enabled` as `shadow`.
pub fn flag_name(group: &str, field: &str) -> String {
    let name = match (group, field) {
        ("", field) => field.to_owned(),
        (group, "enabled") => group.to_owned(),
        (group, field) => format!("{group}-{field}"),
    };
    name.replace('_', "-")
}

/// Clap keeps the names for the life of the program, so they are made once.
fn all() -> &'static [Flag] {
    static FLAGS: OnceLock<Vec<Flag>> = OnceLock::new();
    FLAGS.get_or_init(|| {
        let defaults = Settings::default();
        let flag = |(place, group, field): (Place, &str, &'static Field)| {
            let name = flag_name(group, field.name);
            Flag {
                place,
                field,
                no: format!("no-{name}"),
                name,
                help: help(field, defaults.get(place)),
                heading: match group {
                    "" => "Settings".into(),
                    group => format!("Settings: {group}"),
                },
                default: defaults.get(place),
            }
        };
        defaults.places().into_iter().map(flag).collect()
    })
}

fn help(field: &Field, default: Value) -> String {
    let doc = field.doc.trim().trim_end_matches('.');
    match field.kind {
        Kind::Switch => doc.into(),
        kind => format!(
            "{doc} [{}; default {}]",
            kind.allowed(),
            default.to_text(&kind)
        ),
    }
}

fn arguments(flag: &'static Flag) -> [Option<Arg>; 2] {
    let arg = |name: &'static str, help: String| {
        Arg::new(name)
            .long(name)
            .help(help)
            .help_heading(flag.heading.as_str())
    };
    let name = flag.name.as_str();
    if flag.field.kind == Kind::Switch {
        let on = flag.default == Value::Switch(true);
        let switch = |arg: Arg, shown: bool| arg.action(ArgAction::SetTrue).hide(!shown);
        let not = format!("Not: {}", flag.help);
        return [
            Some(switch(arg(name, flag.help.clone()), !on)),
            Some(switch(arg(&flag.no, not), on).overrides_with(name)),
        ];
    }
    let kind = flag.field.kind;
    let valued = arg(name, flag.help.clone())
        .value_name("X")
        .allow_hyphen_values(true)
        .value_parser(move |text: &str| kind.parse(text));
    [Some(valued), None]
}

impl clap::Args for SettingFlags {
    fn augment_args(command: Command) -> Command {
        command.args(all().iter().flat_map(arguments).flatten())
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl clap::FromArgMatches for SettingFlags {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut flags = Self::default();
        flags.update_from_arg_matches(matches)?;
        Ok(flags)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        for flag in all() {
            if flag.field.kind == Kind::Switch {
                for (name, value) in [(&flag.name, true), (&flag.no, false)] {
                    if matches.get_flag(name) {
                        self.0.push((flag.place, Value::Switch(value)));
                    }
                }
            } else if let Some(value) = matches.get_one::<Value>(&flag.name) {
                self.0.push((flag.place, *value));
            }
        }
        Ok(())
    }
}
