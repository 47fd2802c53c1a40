//! What the tool's help says of all commands: grouped by what a person wants to do, with examples.
//!
//! Every command is in one group and has an example; tests hold that the examples are command lines which are understood.

use clap::Command;
use clap::builder::StyledStr;

use super::help::flowing;
use crate::width::{COLUMNS, folded_to};

/// What a person wants to do, and the commands that do it.
struct Task {
    heading: &'static str,
    commands: &'static [(&'static str, Examples)],
}

/// Command lines with what they are for.
type Examples = &'static [(&'static str, &'static str)];

const TASKS: &[Task] = &[
    Task {
        heading: "See what it does",
        commands: &[
            (
                "demo",
                &[
                    ("a push, and the pose that is felt", "palpate demo"),
                    ("a part of yours, and what the host had to go by", "palpate demo --part part.toml --keep push"),
                ],
            ),
            (
                "simulate-device",
                &[
                    ("a finger for your orders", "palpate simulate-device --link /tmp/finger"),
                    ("one that others reach", "palpate simulate-device --listen 127.0.0.1:4000"),
                ],
            ),
            (
                "simulate-passing",
                &[(
                    "what barriers tell of a part that goes by",
                    "palpate simulate-passing examples/part.toml --passing examples/passing.toml --pose -150,-10,30",
                )],
            ),
            (
                "simulate-robot",
                &[(
                    "a robot that carries a simulated finger to a part",
                    "palpate simulate-robot --part examples/part.toml --pose 120,80,30",
                )],
            ),
        ],
    },
    Task {
        heading: "Connect and calibrate a finger",
        commands: &[
            ("ports", &[("which ports there are", "palpate ports")]),
            ("info", &[("who answers at a port", "palpate info -d /dev/ttyACM0")]),
            #[cfg(feature = "flash")]
            (
                "flash",
                &[
                    (
                        "other firmware onto a board, by USB",
                        "palpate flash palpate-0.2.0-ads131m02.dfu -d /dev/ttyACM0",
                    ),
                    ("one that is in its loader already", "palpate flash palpate-0.2.0-ads131m02.dfu"),
                    ("all of it but for the board", "palpate flash palpate-0.2.0-ads131m02.dfu -d sim:"),
                ],
            ),
            ("diagnose", &[("is the finger well", "palpate diagnose -d /dev/ttyACM0")]),
            (
                "calibrate",
                &[
                    ("12 contacts with a weight of 204 g", "palpate calibrate -d /dev/ttyACM0 --load \"204 g\""),
                    ("the same steps by a simulated hand", "palpate calibrate -d sim: --load \"2 N\""),
                    ("a plan to edit", "palpate calibrate --print-plan"),
                ],
            ),
            (
                "wave",
                &[
                    ("the swings, for a robot", "palpate wave --print-motion"),
                    ("record them and find the finger's mass", "palpate wave -d /dev/ttyACM0"),
                ],
            ),
            (
                "locate-tip",
                &[("from touches on a block", "palpate locate-tip touches.toml -c calibration/finger-a/DATE.toml")],
            ),
            (
                "zero-drift",
                &[
                    ("at rest, while the room warms", "palpate zero-drift -d /dev/ttyACM0 --minutes 90"),
                    ("from a recording of it", "palpate zero-drift -d file:night.mcap"),
                ],
            ),
        ],
    },
    Task {
        heading: "Feel contacts and forces",
        commands: &[
            (
                "monitor",
                &[
                    ("full screen", "palpate monitor -d /dev/ttyACM0"),
                    ("for a program, 50 readings a second", "palpate monitor -d /dev/ttyACM0 --json --print-hz 50"),
                    ("and keep the run", "palpate monitor -d /dev/ttyACM0 --record run.mcap"),
                ],
            ),
            #[cfg(feature = "web")]
            ("serve", &[("in a browser of this machine", "palpate serve -d /dev/ttyACM0")]),
            ("contact", &[("what was felt in a table of forces", "palpate contact forces.csv --tare 0:1")]),
        ],
    },
    Task {
        heading: "Find where a part is",
        commands: &[
            (
                "observe",
                &[
                    (
                        "while the finger begins to push",
                        "palpate observe -d /dev/ttyACM0 --part part.toml --motion motion.toml",
                    ),
                    (
                        "from a table of another program, places measured",
                        "palpate observe log.csv --part part.toml --path log.csv --columns \"t=time[ms],path_t=time[ms]\"",
                    ),
                    (
                        "from a file of forces, drawn",
                        "palpate observe forces.csv --part part.toml --motion motion.toml --plot pose.svg",
                    ),
                ],
            ),
            (
                "which-part",
                &[(
                    "one of two parts",
                    "palpate which-part forces.csv --part a.toml --part b.toml --motion motion.toml",
                )],
            ),
            (
                "friction",
                &[(
                    "mu and mu_c by a push of a part of 200 g",
                    "palpate friction forces.csv --part part.toml --motion motion.toml --mass-g 200,1",
                )],
            ),
            (
                "touch",
                &[
                    (
                        "with a simulated robot",
                        "palpate touch -d sim:1 --robot sim: --part examples/part.toml --area-mm 0,0,200,200 --mass-kg 1",
                    ),
                    (
                        "which part it is",
                        "palpate touch -d sim:1 --robot sim: --library examples/parts --area-mm 0,0,200,200 --mass-kg 1",
                    ),
                ],
            ),
            ("inscribe", &[("from lines of sight", "palpate inscribe examples/part.toml --views examples/views.toml")]),
            (
                "palm",
                &[(
                    "contacts from standard input, on a grid of 1 mm",
                    "palpate palm examples/pebble.toml --grid-mm 1 < contacts.jsonl",
                )],
            ),
        ],
    },
    Task {
        heading: "Plan what to do next",
        commands: &[
            ("part", &[("what palpate makes of a drawing", "palpate part examples/plate.dxf --plot plate.svg")]),
            (
                "plan-push",
                &[(
                    "how to go on after a push that left several poses",
                    "palpate plan-push forces.csv --part part.toml --motion motion.toml",
                )],
            ),
            (
                "push",
                &[
                    ("how a part would move", "palpate push examples/part.toml --edge 0 --speed-mm-s 50"),
                    ("drawn", "palpate push examples/part.toml --edge 0 --speed-mm-s 50 --plot push.svg"),
                ],
            ),
            (
                "roll",
                &[(
                    "how a body would roll",
                    "palpate roll examples/pebble.toml --attitude-deg 40,20,0 --turning-deg-s 200,-250,50",
                )],
            ),
            (
                "sample",
                &[
                    ("where to put points that tell shapes apart", "palpate sample examples/scene.toml"),
                    ("what their readings mean", "palpate sample --decode plan.json 01?0"),
                    ("the same as they come", "palpate sample --decode plan.json < examples/readings.txt"),
                ],
            ),
            ("corner", &[("how a part comes to rest in a corner", "palpate corner examples/part.toml --stable")]),
        ],
    },
    Task {
        heading: "Record and look back",
        commands: &[
            ("record", &[("ten seconds", "palpate record run.mcap -d /dev/ttyACM0 --seconds 10")]),
            (
                "replay",
                &[
                    ("what was printed, again", "palpate replay run.mcap"),
                    ("what another command makes of it", "palpate replay run.mcap -- diagnose"),
                ],
            ),
            ("recover", &[("what a damaged file still has", "palpate recover run.mcap")]),
            (
                "report",
                &[
                    ("one page with figures, for a browser or a printer", "palpate report run.mcap"),
                    ("under another name", "palpate report run.mcap -o monday.html"),
                ],
            ),
            (
                "export",
                &[
                    ("the forces, as other commands read them", "palpate export run.mcap -o forces.csv"),
                    ("which topics there are", "palpate export run.mcap --list"),
                    ("the contacts as a table", "palpate export run.mcap /finger/contact > contacts.csv"),
                    ("everything as JSON Lines", "palpate export run.mcap --json > run.jsonl"),
                ],
            ),
            (
                "import",
                &[("pushing logs of CMU's Manipulation Lab", "palpate import --format mlab log.json --into pushes")],
            ),
        ],
    },
    Task {
        heading: "Compare with the thesis",
        commands: &[(
            "tables",
            &[
                ("what there is, and how long it takes", "palpate tables --list"),
                ("a few cases of one", "palpate tables 6.1 --cases 20"),
                ("figures 6.1 to 6.4", "palpate tables 6 --plot figures"),
            ],
        )],
    },
    Task {
        heading: "Use it from programs and shells",
        commands: &[
            ("solve", &[("a problem a line", "palpate solve < problems.jsonl > answers.jsonl")]),
            (
                "completions",
                &[("of bash", "palpate completions bash > ~/.local/share/bash-completion/completions/palpate")],
            ),
            ("man", &[("the manual pages of all commands", "palpate man ~/.local/share/man/man1")]),
        ],
    },
];

/// Stands at the end of the tool's own help, and on its manual page.
const EXIT_STATUS: &str = "\
Exit status:
  0    done; \"no contact\" and \"no part fits\" are answers too
  1    could not be done: standard error says why, and what to do
  2    done in part: some lines or pushes were passed over, or no pose fits
  3    answered, but some samples were no measurements, or data is missing
  64   wrong command line
  130  interrupted: what was done is kept, and printed
  141  nobody reads the output any more
What a command does not have, or has besides, its own help says.";

/// The tool's command line with what is said here of it.
pub(super) fn described(mut command: Command) -> Command {
    for (name, examples) in TASKS.iter().flat_map(|task| task.commands) {
        command = command.mut_subcommand(name, |below| with_examples(below, examples));
    }
    let listed = listed(&command);
    command.help_template(listed).after_long_help(EXIT_STATUS)
}

/// A command whose long help ends with these examples.
fn with_examples(command: Command, examples: Examples) -> Command {
    let before = command.get_after_long_help().map(|text| format!("{}\n\n", text.ansi())).unwrap_or_default();
    let heading = if examples.len() == 1 { "Example" } else { "Examples" };
    let lines = examples.iter().map(|(what, line)| format!("  # {what}\n{}", command_line(line)));
    let lines = lines.collect::<Vec<_>>().join("\n");
    command.after_long_help(format!("{before}{heading}:\n{lines}"))
}

/// A command line on a terminal: what is too long goes on below, as a shell reads it.
fn command_line(line: &str) -> String {
    /// For the backslash at the end of a line that goes on.
    const ROOM: usize = 2;
    let broken = folded_to(&format!("  {line}"), COLUMNS - ROOM);
    broken.lines().collect::<Vec<_>>().join(" \\\n  ")
}

/// The template of the tool's help: its commands, task by task.
fn listed(command: &Command) -> StyledStr {
    let header = command.get_styles().get_header();
    let literal = command.get_styles().get_literal();
    let names = TASKS.iter().flat_map(|task| task.commands).map(|(name, _)| name.len());
    let width = names.max().unwrap_or(0) + 2;
    let mut text = "{about-with-newline}\n{usage-heading} {usage}\n".to_owned();
    for Task { heading, commands } in TASKS {
        text += &format!("\n{header}{heading}:{header:#}\n");
        for (name, _) in *commands {
            let about = command.find_subcommand(name).and_then(Command::get_about).map(|about| about.to_string());
            let indent = " ".repeat(width + 2);
            let about = folded_to(&format!("{indent}{}", about.unwrap_or_default()), COLUMNS);
            text += &format!("  {literal}{name}{literal:#}{}{}\n", " ".repeat(width - name.len()), about.trim_start());
        }
    }
    text += &format!("\n{header}Options:{header:#}\n{{options}}\n\n");
    text += &flowing("`palpate COMMAND --help` explains a command, with an example.");
    text += "{after-help}";
    text.into()
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;
    use crate::cli::{Arguments, command};

    #[test]
    fn every_command_has_its_place_and_every_place_its_command() {
        let mut placed: Vec<_> = TASKS.iter().flat_map(|task| task.commands).map(|(name, _)| *name).collect();
        let command = command();
        let mut there: Vec<_> = command.get_subcommands().map(Command::get_name).collect();
        placed.sort_unstable();
        there.sort_unstable();
        assert_eq!(placed, there);
    }

    /// The words of a command line up to where the shell takes over.
    fn words(line: &str) -> Vec<String> {
        let own = line.split(" < ").next().and_then(|own| own.split(" > ").next()).unwrap_or_default();
        let quoted = own.split('"').enumerate();
        let words = quoted.flat_map(|(number, piece)| match number % 2 {
            0 => piece.split_whitespace().map(str::to_owned).collect(),
            _ => vec![piece.to_owned()],
        });
        words.collect()
    }

    #[test]
    fn every_example_is_a_command_line_of_its_command() {
        for (name, examples) in TASKS.iter().flat_map(|task| task.commands) {
            assert!(!examples.is_empty(), "{name} has no example");
            for (_, line) in *examples {
                let words = words(line);
                assert_eq!([words[0].as_str(), words[1].as_str()], ["palpate", name]);
                if let Err(error) = Arguments::try_parse_from(&words) {
                    panic!("{line}: {error}");
                }
            }
        }
    }

    #[test]
    fn a_long_command_line_goes_on_as_a_shell_reads_it() {
        let long = format!("palpate touch {}", ["--area-mm 0,0,200,200"; 6].join(" "));
        let broken = command_line(&long);
        assert!(broken.lines().count() > 1 && broken.lines().all(|line| line.chars().count() <= COLUMNS), "{broken}");
        assert_eq!(broken.split_whitespace().filter(|word| *word != "\\").collect::<Vec<_>>().join(" "), long);
    }
}
