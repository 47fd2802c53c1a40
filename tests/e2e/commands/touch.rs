//! `palpate touch` as a person uses it: on a simulated part, in this process and over lines, and what it says when it cannot.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use palpate_tests::rig::{peer_that_says, robot_that_tells};
use serde_json::Value;

use crate::PALPATE;

const PART: &str = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 25], [35, 45], [0, 30]]\nmu = 0.3\nmu_c = 0.25\n";

const SQUARE: &str = "unit = 'mm'\nvertices = [[0, 0], [40, 0], [40, 40], [0, 40]]\nmu = 0.3\nmu_c = 0.25\n";

/// Within which a pose is asked for: those of the command's own defaults.
const TOLERANCE_M: f64 = 2e-4;
const TOLERANCE_DEG: f64 = 0.3;

fn part(folder: &Path, text: &str) -> PathBuf {
    let path = folder.join("part.toml");
    std::fs::write(&path, text).unwrap();
    path
}

fn palpate(arguments: &[&str]) -> Command {
    let mut command = Command::new(PALPATE);
    command.args(arguments).env_remove("PALPATE_DEVICE").env_remove("PALPATE_CALIBRATION").stdin(Stdio::null());
    command
}

fn touch(part: &Path, arguments: &[&str]) -> Output {
    palpate(&["touch", "--part", part.to_str().unwrap()]).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    // Errors are folded with a bar at their margin.
    String::from_utf8_lossy(bytes).replace('│', " ").split_whitespace().collect::<Vec<_>>().join(" ")
}

fn last_object(output: &Output) -> Value {
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let last = said.lines().last().unwrap_or_else(|| panic!("nothing: {}", text(&output.stderr)));
    serde_json::from_str(last).unwrap_or_else(|error| panic!("{error}: {said}"))
}

#[test]
fn a_simulated_part_is_found_within_the_tolerance() {
    let folder = tempfile::tempdir().unwrap();
    let file = part(folder.path(), PART);
    let simulated = ["-d", "sim:3", "--robot", "sim:", "--simulated-pose", "90,70,40", "--mass-kg", "1", "--json"];
    let picture = folder.path().join("touch.svg");
    let asked = ["--area-mm", "0,0,160,160", "--plot", picture.to_str().unwrap()];
    let output = touch(&file, &[&simulated[..], &asked].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let end = last_object(&output);
    assert_eq!(end["verdict"], "one", "{end}");
    let pose = &end["poses"][0];
    let [x, y, theta] = ["x", "y", "theta"].map(|key| pose[key].as_f64().unwrap());
    // The file's origin, a lever from the centroid, where 0.3° are as much again.
    let off = (x - 0.09).hypot(y - 0.07);
    let turn = (theta.to_degrees() - 40.0 + 180.0).rem_euclid(360.0) - 180.0;
    assert!(off <= 2.0 * TOLERANCE_M && turn.abs() <= TOLERANCE_DEG, "off by {off} m and {turn}°");
    assert!(text(&output.stderr).contains("SIMULATED"));
    // One object for each approach, with what it met and what is left.
    let lines = String::from_utf8_lossy(&output.stdout).into_owned();
    let approaches: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(approaches.len() as u64, end["approaches"].as_u64().unwrap() + 1);
    let touches = approaches.iter().filter(|object| object["touch"].is_object()).count();
    assert_eq!(touches as u64, end["touches"].as_u64().unwrap());
    // And a panel in the picture.
    let drawn = std::fs::read_to_string(&picture).unwrap();
    for (number, approach) in (1..).zip(&approaches[..approaches.len() - 1]).skip(approaches.len().saturating_sub(13)) {
        let met = if approach["touch"].is_null() { "nothing there" } else { "touched" };
        assert!(drawn.contains(&format!("\"{number}: {met}; ")), "{number}: {drawn}");
    }
    assert!(drawn.contains("; 1 pose left\""), "{drawn}");
}

#[test]
fn of_a_square_it_says_that_touch_cannot_tell_its_turns() {
    let folder = tempfile::tempdir().unwrap();
    let file = part(folder.path(), SQUARE);
    let output = touch(&file, &["-d", "sim:4", "--robot", "sim:", "--area-mm", "0,0,120,120", "--mass-kg", "2"]);
    let said = text(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{said}{}", text(&output.stderr));
    assert!(said.contains("Touch cannot tell these poses apart") && said.contains("4 poses left"), "{said}");
}

#[test]
fn the_demonstration_finds_its_part_and_reveals_the_truth() {
    let output = palpate(&["demo", "--touch", "--seed", "2"]).output().unwrap();
    let said = text(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{said}{}", text(&output.stderr));
    crate::observe::assert_fits_a_terminal(&String::from_utf8_lossy(&output.stdout));
    let off = said.split_once("nowhere more than ").unwrap().1.split_once(" mm").unwrap().0;
    assert!(off.parse::<f64>().unwrap() <= 0.5 && said.contains("Nothing here was measured"), "{said}");
}

#[test]
fn an_unknown_part_is_explored_into_a_file_by_which_it_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let truth = part(folder.path(), PART);
    let [out, picture] = ["felt.toml", "felt.svg"].map(|name| folder.path().join(name));
    let lies = ["-d", "sim:7", "--robot", "sim:", "--area-mm", "0,0,120,120", "--simulated-pose", "40,45,25"];
    let explore =
        [&["touch", "--explore", "--touches", "40", "--json", "--out", out.to_str().unwrap()][..], &lies].concat();
    let files = ["--simulated-part", truth.to_str().unwrap(), "--plot", picture.to_str().unwrap()];
    let output = palpate(&[&explore[..], &files].concat()).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let end = last_object(&output);
    let corners = end["outline"]["vertices"].as_array().unwrap();
    // Every corner of the part in its pose is one of the outline.
    let (sin, cos) = 25.0_f64.to_radians().sin_cos();
    for [x, y] in [[0.0, 0.0], [0.06, 0.0], [0.06, 0.025], [0.035, 0.045], [0.0, 0.03]] {
        let [x, y] = [0.04 + cos * x - sin * y, 0.045 + sin * x + cos * y];
        let off = |corner: &Value| (corner[0].as_f64().unwrap() - x).hypot(corner[1].as_f64().unwrap() - y);
        let nearest = corners.iter().map(off).fold(f64::INFINITY, f64::min);
        assert!(nearest <= 3e-4, "a corner is {nearest} m off: {end}");
    }
    assert!(std::fs::read_to_string(&picture).unwrap().contains("An unknown part after 40 touches"));
    let file = std::fs::read_to_string(&out).unwrap();
    assert!(file.contains("outline_sigma = ") && file.contains("mu = 0.3 # told"), "{file}");
    // By the file the same part is found elsewhere: it is in the robot's frame as it was explored.
    let moved = ["-d", "sim:8", "--robot", "sim:", "--area-mm", "0,0,120,120", "--mass-kg", "20"];
    let found = touch(&out, &[&moved[..], &["--simulated-pose", "10,5,0", "--json"]].concat());
    let end = last_object(&found);
    assert_eq!(end["verdict"], "one", "{end}{}", text(&found.stderr));
    let [x, y] = ["x", "y"].map(|key| end["poses"][0][key].as_f64().unwrap());
    assert!((x - 0.01).hypot(y - 0.005) <= 3.0 * TOLERANCE_M, "{end}");
    // What is there is not written over, and that is said before anything is touched.
    let again = palpate(&explore).output().unwrap();
    assert!(again.status.code() == Some(1) && text(&again.stderr).contains("is there"), "{}", text(&again.stderr));
}

/// An hour of touching is not lost.
#[test]
#[cfg(unix)]
fn what_was_explored_until_it_is_interrupted_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("felt.toml");
    let explore = ["touch", "--explore", "--touches", "5000", "--out", out.to_str().unwrap()];
    let lies = ["-d", "sim:7", "--robot", "sim:", "--area-mm", "0,0,120,120"];
    let mut child =
        palpate(&[&explore[..], &lies].concat()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
    let sigma_mm = |line: &str| line.split_once("known to ± ")?.1.strip_suffix(" mm")?.parse::<f64>().ok();
    assert!(lines.any(|line| sigma_mm(&line).is_some_and(|sigma| sigma < 0.1)), "no outline");
    crate::progress::interrupt(&child);
    lines.for_each(drop);
    let output = child.wait_with_output().unwrap();
    let said = text(&output.stderr);
    assert!(output.status.code() == Some(130) && said.contains("interrupted; the robot was stopped"), "{said}");
    let file = std::fs::read_to_string(&out).unwrap();
    assert!(said.contains("written to") && file.contains("outline_sigma = "), "{said}{file}");
}

#[test]
fn a_touch_outside_of_the_area_ends_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = part(folder.path(), PART);
    // Slowly, so that it presses with less than the limit.
    let slowly = ["--travel-mm-s", "10", "--force-limit", "15"];
    let arguments =
        [&["-d", "sim:5", "--robot", "sim:", "--area-mm", "0,0,100,100", "--mass-kg", "2"][..], &slowly].concat();
    // Where the robot passes on its way round: it begins at (-25, -25) mm and the first approach is anywhere.
    for pose in ["--simulated-pose=-70,20,0", "--simulated-pose=20,-60,0"] {
        let output = touch(&file, &[&arguments[..], &[pose]].concat());
        if output.status.code() == Some(1) {
            let said = text(&output.stderr);
            assert!(said.contains("outside of where the part is said to be") && said.contains("--area-mm"), "{said}");
            return;
        }
    }
    panic!("the finger passed neither");
}

#[test]
fn what_cannot_be_begun_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let file = part(folder.path(), PART);
    let area = ["--area-mm", "0,0,160,160", "-d", "sim:1"];
    let with = |arguments: &[&str]| {
        let output = touch(&file, &[&area[..], arguments].concat());
        assert_eq!(output.status.code(), Some(1), "{}", text(&output.stdout));
        text(&output.stderr)
    };
    let silent = peer_that_says(b"0.1 0 0\nrubbish\n".to_vec());
    let said = with(&["--mass-kg", "1", "--robot", &format!("tcp:{silent}")]);
    assert!(said.contains("rubbish") && said.contains("docs/ROBOT.md"), "{said}");
    let lost = peer_that_says(Vec::new());
    let said = with(&["--mass-kg", "1", "--robot", &format!("tcp:{lost}")]);
    assert!(said.contains("has told no place for") && said.contains("is the robot's program running"), "{said}");
    let millimetres = robot_that_tells(|s| format!("{s} -100 -100"));
    let said = with(&["--mass-kg", "1", "--robot", &format!("tcp:{millimetres}")]);
    assert!(said.contains("141 m from where the part") && said.contains("lengths are in metres"), "{said}");
    let said = with(&["--robot", "sim:", "--mass-kg", "1", "--force-limit", "0.05"]);
    assert!(said.contains("above 0.05 N, before a touch begins at 0.1 N") && said.contains("--force-limit"), "{said}");
    let said = with(&["--robot", "sim:"]);
    assert!(said.contains("--mass-kg") && said.contains("--speed-mm-s"), "{said}");
    let said = with(&["--robot", "sim:", "--mass-kg", "0.001", "--motion-max-mm", "0.001"]);
    assert!(said.contains("no speed is safe") && said.contains("--touch-force"), "{said}");
    let said = with(&["--robot", "sim:", "--speed-mm-s", "200"]);
    assert!(said.contains("above the limit of 5 N"), "{said}");
    let said = with(&["--mass-kg", "1", "--simulated-pose", "0,0,0"]);
    assert!(said.contains("no part is simulated"), "{said}");
    let small = touch(&file, &["-d", "sim:1", "--robot", "sim:", "--mass-kg", "1", "--area-mm", "0,0,30,30"]);
    assert!(text(&small.stderr).contains("does not fit"), "{}", text(&small.stderr));
    for wrong in [
        &["--area-mm", "0,0,1"][..],
        &["--area-mm", "0,0,160,160", "--out", "felt.toml"],
        &["--area-mm", "0,0,0,5"],
        &["--area-mm", "0,0,160,1e7"],
        &["--force-limit", "0"],
    ] {
        let output = touch(&file, &[&["--mass-kg", "1"], wrong].concat());
        assert_eq!(output.status.code(), Some(64), "{wrong:?}: {}", text(&output.stderr));
    }
}

/// Each command that takes a file says which kind it got and which it wants.
#[test]
fn a_file_of_another_kind_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let files = [
        ("part.toml", PART),
        ("motion.toml", "unit = 'mm'\n[[segment]]\nseconds = 1\nacceleration = [1, 0]\n"),
        ("views.toml", "unit = 'mm'\n[[fence]]\nnormal = -90\noffset = 0\n"),
        (
            "beams.toml",
            "unit = 'mm'\nvelocity = [120, 0]\n[[barrier]]\nid = 1\nat = [0, 0]\ndirection = 90\nsigma = 0.05\ntime_sigma_ms = 1\n",
        ),
        ("scene.toml", "unit = 'mm'\n[[shape]]\nname = 'a'\nvertices = [[0, 0], [60, 0], [60, 25]]\n"),
        ("other.json", "{\"poses\": []}"),
    ];
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let touch = "--area-mm 0,0,160,160 -d sim:1 --robot sim: --mass-kg 1";
    for (command, named, wanted) in [
        (format!("touch --part motion.toml {touch}"), "a motion file", "a part file"),
        (format!("touch --part views.toml {touch}"), "a view file", "a part file"),
        (format!("touch --library . {touch}"), "beams.toml", "a part file"),
        ("inscribe part.toml --views motion.toml".to_owned(), "a motion file", "a view file"),
        ("inscribe part.toml --views beams.toml".to_owned(), "a file of beams", "a view file"),
        ("inscribe part.toml --passing views.toml".to_owned(), "a view file", "a file of beams"),
        ("inscribe scene.toml --views views.toml".to_owned(), "a scene", "a part file"),
        ("sample part.toml".to_owned(), "a part file", "a scene"),
        ("sample --decode scene.toml 01".to_owned(), "scene.toml", "palpate sample SCENE --json"),
        ("sample --decode other.json 01".to_owned(), "other.json", "palpate sample SCENE --json"),
    ] {
        let output = palpate(&command.split(' ').collect::<Vec<_>>()).current_dir(folder.path()).output().unwrap();
        let said = text(&output.stderr);
        let is_named = said.contains(named) && said.contains(wanted);
        assert!(output.status.code() == Some(1) && is_named, "`{command}`, {named}, {wanted}: {said}");
    }
}

/// A simulated robot in a terminal of its own.
struct Terminal {
    child: Child,
    robot: String,
    finger: String,
}

/// Hands on what two peers say to each other, until it is told to hold back what one says.
fn relayed(robot: &str) -> (String, Arc<AtomicBool>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let (address, is_silent) = (format!("tcp:{}", listener.local_addr().unwrap()), Arc::new(AtomicBool::new(false)));
    let (robot, held) = (robot.strip_prefix("tcp:").unwrap().to_owned(), is_silent.clone());
    std::thread::spawn(move || {
        let (host, _) = listener.accept().unwrap();
        let robot = TcpStream::connect(robot).unwrap();
        let hand_on = |mut from: TcpStream, mut to: TcpStream, held: Arc<AtomicBool>| {
            std::thread::spawn(move || {
                let mut bytes = [0; 4096];
                while let Ok(count @ 1..) = from.read(&mut bytes) {
                    if !held.load(Ordering::Relaxed) && to.write_all(&bytes[..count]).is_err() {
                        return;
                    }
                }
            })
        };
        hand_on(robot.try_clone().unwrap(), host.try_clone().unwrap(), held);
        hand_on(host, robot, Arc::default());
    });
    (address, is_silent)
}

/// A search by touch with a simulated robot in another program, as lines for a person, until the outline's centroid is
/// within a tolerance.
#[cfg(unix)]
fn search(folder: &Path, robot: &str, finger: &str, tolerance_mm: &str) -> Child {
    let (calibration, file) = (calibration(folder, 6), part(folder, PART));
    let arguments = ["touch", "--part", file.to_str().unwrap(), "-c", calibration.to_str().unwrap()];
    let motion = ["--area-mm", "0,0,100,100", "--mass-kg", "20", "--travel-mm-s", "100"];
    let there = ["-d", finger, "--robot", robot, "--tolerance-mm", tolerance_mm];
    let mut command = palpate(&[&arguments[..], &motion, &there].concat());
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
#[cfg(unix)]
fn a_robot_that_is_lost_in_the_midst_is_told_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let lies =
        ["--pose", "40,20,30", "--mass-kg", "20", "--start-mm=-30,-30", "--seed", "6", "--listen", "tcp:127.0.0.1:0"];
    let there = Terminal::simulate_robot(&lies);
    let (address, is_silent) = relayed(&there.robot);
    let mut touch = search(folder.path(), &address, &there.finger, "0.2");
    let mut lines = BufReader::new(touch.stdout.take().unwrap()).lines();
    let first = lines.find_map(Result::ok).unwrap_or_default();
    assert!(first.starts_with("approach 1"), "{first}");
    is_silent.store(true, Ordering::Relaxed);
    let output = touch.wait_with_output().unwrap();
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    for words in [&address[..], "has told no place for ", "is the robot's program running?"] {
        assert!(said.contains(words), "{words}: {said}");
    }
}

/// Runs of a search in real time: a machine that is too busy loses samples or the robot, which is stopped, as it should be.
const RUNS_MAX: usize = 5;

#[test]
#[cfg(unix)]
fn a_part_that_is_moved_meanwhile_is_told_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let lies = ["--pose", "40,20,30", "--mass-kg", "20", "--start-mm=-30,-30", "--seed", "6"];
    let run = |_: usize| {
        let mut there = Terminal::simulate_robot(&lies);
        // So small a tolerance asks for a fourth touch: three that two edges explain are explained by a part that slid.
        let mut touch = search(folder.path(), &there.robot, &there.finger, "0.03");
        let (mut printed, mut touches) = (String::new(), 0);
        for line in BufReader::new(touch.stdout.take().unwrap()).lines().map_while(Result::ok) {
            touches += usize::from(line.trim_start().starts_with("touched"));
            // Its pose is known by then.
            if touches == 3 && line.starts_with("approach") {
                there.child.stdin.as_mut().unwrap().write_all(b"part 48,12,38\n").unwrap();
            }
            printed += &(line + "\n");
        }
        let output = touch.wait_with_output().unwrap();
        (output.status.code(), format!("{} {}", text(printed.as_bytes()), text(&output.stderr)))
    };
    let is_too_busy = |said: &str| said.contains("samples were lost") || said.contains("has told no place for");
    let (code, said) = (0..RUNS_MAX).map(run).find(|(_, said)| !is_too_busy(said)).unwrap();
    let is_early = code == Some(1)
        && said.contains("mm before any pose that is left: the part was moved")
        && said.contains("hold the part");
    let is_none = code == Some(2)
        && said.contains("No pose of this part fits what was felt")
        && said.contains("it was moved")
        && said.contains("Hold it still");
    assert!(is_early || is_none, "{code:?}: {said}");
}

impl Terminal {
    fn simulate_robot(arguments: &[&str]) -> Self {
        let mut child = palpate(&["simulate-robot"])
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
        let [robot, finger] = [lines.next().unwrap(), lines.next().unwrap()];
        Self { child, robot, finger }
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The calibration of the simulated finger of a seed.
fn calibration(folder: &Path, seed: u64) -> PathBuf {
    let output = palpate(&["calibrate", "-d", &format!("sim:{seed}"), "--load", "2 N", "--contacts", "8", "--out"])
        .arg(folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    PathBuf::from(said.lines().find_map(|line| line.strip_prefix("written")).unwrap().trim())
}

#[test]
#[cfg(unix)]
fn over_lines_in_real_time_a_part_is_found_and_another_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let calibration = calibration(folder.path(), 6);
    let file = part(folder.path(), PART);
    let lies = ["--pose", "40,20,30", "--mass-kg", "20", "--start-mm=-30,-30", "--seed", "6"];
    // The part that is there, and one that is told for it.
    let told = folder.path().join("told.toml");
    std::fs::write(&told, SQUARE.replace("40", "33")).unwrap();
    // Three touches may fit a wrong part too; a small tolerance asks for more.
    for (told, is_right, tolerance_mm) in [(&file, true, "0.2"), (&told, false, "0.03")] {
        let robot = Terminal::simulate_robot(&[&lies[..], &["--part", file.to_str().unwrap()]].concat());
        let output = touch(
            told,
            &[
                &["-d", &robot.finger, "--robot", &robot.robot, "-c", calibration.to_str().unwrap()][..],
                &["--area-mm", "0,0,100,100", "--mass-kg", "20", "--travel-mm-s", "100", "--json"],
                &["--tolerance-mm", tolerance_mm],
            ]
            .concat(),
        );
        let said = text(&output.stderr);
        if is_right {
            let end = last_object(&output);
            assert_eq!(end["verdict"], "one", "{end}\n{said}");
            let pose = &end["poses"][0];
            let [x, y] = ["x", "y"].map(|key| pose[key].as_f64().unwrap());
            assert!((x - 0.04).hypot(y - 0.02) <= 2.0 * TOLERANCE_M, "{end}");
        } else {
            // It shows as touches that no pose explains, or as one before any pose that is left.
            let is_named = match output.status.code() {
                Some(2) => last_object(&output)["verdict"] == "none",
                Some(1) => said.contains("the part was moved, or it is another"),
                _ => false,
            };
            assert!(is_named, "{:?}: {said}\n{}", output.status, text(&output.stdout));
        }
    }
}
