//! The image and the chip around its processor: what it writes into registers, whoever started it, and what DRDY's edges
//! do. Through the emulator's test socket, beside its serial line.
//!
//! The emulator has no chip on SPI1, so an edge can only show that the interrupt comes, once an edge, and that nothing
//! becomes a sample. It has no clock unit and no pins either: what the image writes there is read from the emulator's log of
//! what it does not have. Addresses and fields: RM0090, and the ARMv7-M manual.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;

use palpate_device::Session;
use palpate_shared::wire::{Outcome, Request};

use super::emulator::{self, Serial};
use super::{ATTEMPTS, Address, Command, Duration, Machine, Stdio, TcpListener, image};

/// The vector table's address, for the processor.
const VTOR: u32 = 0xE000_ED08;

/// Where the image and its vector table begin.
const FLASH_START: u32 = 0x0800_0000;

/// Where the chip may be found among the emulator's objects, depending on machine and version.
const CHIPS: [&str; 2] = ["/machine/unattached/device[0]", "/machine/soc"];

/// How often the sampler's interrupt comes without an edge, in µs.
const IDLE_US: u32 = 10_000;

/// How often the device looks at its health, in µs: every 0.1 s; and half as much for the look itself.
const LOOK_US: u32 = 150_000;

/// A line of the emulator's own, to which each order is answered.
struct Control {
    orders: UnixStream,
    answers: BufReader<UnixStream>,
}

impl Control {
    fn open(socket: &Path) -> Self {
        for _ in 0..ATTEMPTS {
            if let Ok(orders) = UnixStream::connect(socket) {
                orders.set_read_timeout(Some(palpate_tests::rig::PATIENCE)).expect("a socket can be waited for");
                let answers = BufReader::new(orders.try_clone().expect("a socket has two ends"));
                return Self { orders, answers };
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        panic!("the emulator does not listen at {}", socket.display());
    }

    /// Orders something and waits for the line that begins with one of these words, which it gives.
    fn order(&mut self, order: &str, answers: &[&str]) -> String {
        self.orders.write_all(format!("{order}\n").as_bytes()).expect("the emulator listens");
        loop {
            let mut line = String::new();
            assert!(
                self.answers.read_line(&mut line).is_ok_and(|length| length > 0),
                "the emulator hung up on {order:?}"
            );
            if answers.iter().any(|answer| line.starts_with(answer)) {
                return line.trim().to_owned();
            }
        }
    }
}

/// A machine whose memory can be reached from outside, held before its first instruction.
struct Held {
    machine: Machine,
    test: Control,
    monitor: Control,
    /// Of the sockets and the log; it goes with this.
    folder: tempfile::TempDir,
}

impl Held {
    fn start() -> Option<Self> {
        Self::start_with(|_| Vec::new())
    }

    /// With more arguments for the emulator; a folder is there for its files.
    fn start_with(more: impl FnOnce(&Path) -> Vec<String>) -> Option<Self> {
        let (image, machine) = image()?;
        let folder = tempfile::tempdir().expect("a folder");
        let socket = |name: &str| format!("unix:{},server=on,wait=off", folder.path().join(name).display());
        let port =
            TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr()).expect("a free port").port();
        let mut command: Command = emulator::command(machine, image, Serial::Tcp { port, wait: false });
        command.args(["-S", "-qtest", &socket("test"), "-qtest-log", "none", "-qmp", &socket("monitor")]);
        command.args(more(folder.path()));
        let process = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the emulator starts");
        let machine = Machine { process, address: Address::Tcp(format!("127.0.0.1:{port}")) };
        let (test, mut monitor) =
            (Control::open(&folder.path().join("test")), Control::open(&folder.path().join("monitor")));
        monitor.order(r#"{"execute":"qmp_capabilities"}"#, &["{\"return\""]);
        Some(Self { machine, test, monitor, folder })
    }

    /// Lets it run.
    fn go(&mut self) -> Session {
        self.monitor.order(r#"{"execute":"cont"}"#, &["{\"return\""]);
        self.machine.open()
    }

    fn read(&mut self, address: u32) -> u32 {
        let answer = self.test.order(&format!("readl {address:#x}"), &["OK", "FAIL"]);
        // Sixteen digits, whatever is read.
        let value = answer.strip_prefix("OK 0x").and_then(|digits| u64::from_str_radix(digits, 16).ok());
        let word = value.and_then(|value| u32::try_from(value).ok());
        word.unwrap_or_else(|| panic!("{address:#010x}: {answer}"))
    }

    fn write(&mut self, address: u32, value: u32) {
        self.test.order(&format!("writel {address:#x} {value:#x}"), &["OK"]);
    }

    /// Sets the level of DRDY at the unit that sees its edges; `chip` is where the emulator keeps that.
    fn set_data_ready(&mut self, chip: &str, high: bool) -> bool {
        let level = u8::from(high);
        let order = format!("set_irq_in {chip}/exti unnamed-gpio-in 3 {level}");
        self.test.order(&order, &["OK", "FAIL"]) == "OK"
    }
}

/// A boot loader may have left the processor with its own vector table.
#[test]
fn the_image_runs_whoever_started_it() {
    let Some(mut held) = Held::start() else { return };
    // Somewhere in the RAM, where no vectors are.
    held.write(VTOR, 0x2001_0000);
    assert_eq!(held.read(VTOR), 0x2001_0000);
    let mut session = held.go();
    session.ping().unwrap();
    assert_eq!(held.read(VTOR), FLASH_START);
}

#[test]
fn registers_hold_what_the_board_needs() {
    let Some(mut held) = Held::start() else { return };
    held.go();
    // What the emulator has of each; by hand from the manuals.
    let wanted = [
        ("SPI1_CR1: master, mode 1, an eighth, own chip select, on", 0x4001_3000, 0xFFFF, 0x0355),
        ("SYSCFG_EXTICR1: line 3 is port C", 0x4001_3808, 0xFFFF, 0x2000),
        ("EXTI_IMR: line 3", 0x4001_3C00, 0x7F_FFFF, 0x0008),
        ("EXTI_RTSR: no rising edge", 0x4001_3C08, 0x7F_FFFF, 0x0000),
        ("EXTI_FTSR: the falling edge of line 3", 0x4001_3C0C, 0x7F_FFFF, 0x0008),
        ("USART1_BRR: 115200 baud from 16 MHz, 139 / 16", 0x4001_1008, 0xFFFF, 0x008B),
        // But for the transmitter's interrupt, which comes and goes.
        ("USART1_CR1: on, both ways, received bytes interrupt", 0x4001_100C, 0xFF7F, 0x202C),
        ("NVIC_ISER0: EXTI3 is interrupt 9", 0xE000_E100, 0xFFFF_FFFF, 1 << 9),
        ("NVIC_ISER1: USART1 is interrupt 37", 0xE000_E104, 0xFFFF_FFFF, 1 << 5),
        ("NVIC_IPR2: EXTI3 has priority 2", 0xE000_E408, 0xFF00, 0x2000),
        ("NVIC_IPR9: USART1 has priority 1", 0xE000_E424, 0xFF00, 0x1000),
        ("SHPR3: SysTick has priority 0", 0xE000_ED20, 0xFF00_0000, 0),
        ("MPU_CTRL: on, with the default map", 0xE000_ED94, 0x7, 0x5),
        ("MPU_RBAR: the RAM's beginning", 0xE000_ED9C, 0xFFFF_FFE0, 0x2000_0000),
        ("MPU_RASR: no access, no code, 256 bytes, on", 0xE000_EDA0, 0xFFFF_FFFF, 0x1000_000F),
    ];
    let found = wanted.map(|(name, address, mask, wanted)| (name, held.read(address) & mask, wanted));
    let wrong: Vec<String> = found
        .iter()
        .filter(|(_, found, wanted)| found != wanted)
        .map(|(name, found, wanted)| format!("{name}: {found:#010x} and not {wanted:#010x}"))
        .collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// What the image writes into units that the emulator does not have, in order, as far as it is the same in every run: unit,
/// offset, value, and what that means. Every register reads 0 there, so a value holds what the image itself sets.
const WRITTEN: [(&str, u32, u32, &str); 21] = [
    ("RCC", 0x74, 0x0100_0000, "CSR: forget why it started"),
    ("RCC", 0x00, 0x0000_0001, "CR: the internal oscillator on"),
    ("RCC", 0x08, 0x0000_0000, "CFGR: run on it, nothing divided"),
    ("RCC", 0x00, 0x0000_0000, "CR: PLL off"),
    ("RCC", 0x00, 0x0001_0000, "CR: crystal on, which does not start here"),
    ("RCC", 0x04, 0x2700_5410, "PLLCFGR: 16 MHz / 16 x 336 / 2, and / 7 for USB"),
    ("RCC", 0x00, 0x0100_0000, "CR: PLL on, which does not lock here"),
    ("RCC", 0x00, 0x0000_0000, "CR: PLL off again"),
    ("RCC", 0x30, 0x0000_0007, "AHB1ENR: ports A, B, C"),
    ("RCC", 0x44, 0x0000_5010, "APB2ENR: USART1, SPI1, SYSCFG"),
    ("GPIOA", 0x18, 0x0000_0010, "BSRR: PA4, chip select, high"),
    ("GPIOC", 0x18, 0x1000_0020, "BSRR: PC5, SYNC/RESET, high; PC12, the LED, low"),
    ("GPIOA", 0x20, 0x5550_0000, "AFRL: PA5, 6, 7 are SPI1's"),
    ("GPIOA", 0x24, 0x000A_A770, "AFRH: PA9, 10 are USART1's, PA11, 12 USB's"),
    ("GPIOA", 0x0C, 0x0010_0000, "PUPDR: pull-up at PA10"),
    ("GPIOA", 0x08, 0x0000_8A00, "OSPEEDR: PA4, 5, 7 high"),
    ("GPIOA", 0x08, 0x03C0_0000, "OSPEEDR: PA11, 12 very high"),
    ("GPIOA", 0x00, 0x02A8_A900, "MODER: PA4 output; PA5 to 7 and 9 to 12 of their units; PA8 and the rest untouched"),
    ("GPIOB", 0x0C, 0x5555_0000, "PUPDR: pull-ups at PB8 to PB15, the inputs"),
    ("GPIOC", 0x0C, 0x0000_0040, "PUPDR: pull-up at PC3, data ready"),
    ("GPIOC", 0x00, 0x0100_0400, "MODER: PC5 and PC12 outputs, PC3 an input"),
];

/// A line of the emulator's log as unit, offset and value, if it is of something written to one of these units.
fn written(line: &str) -> Option<(&str, u32, u32)> {
    let (unit, rest) = line.split_once(": unimplemented device write (size ")?;
    let number = |name: &str| {
        let digits = rest.split_once(name)?.1.split([',', ')']).next()?;
        u32::from_str_radix(digits.trim().strip_prefix("0x")?, 16).ok()
    };
    Some((unit, number("offset ")?, number("value ")?))
}

#[test]
fn clock_and_pins_are_set_as_the_board_needs_them_and_in_that_order() {
    let log = |folder: &Path| folder.join("log");
    let options = |folder: &Path| ["-d", "unimp", "-D", &log(folder).display().to_string()].map(str::to_owned).to_vec();
    let Some(mut held) = Held::start_with(options) else { return };
    held.go().ping().unwrap();
    let text = std::fs::read_to_string(log(held.folder.path())).expect("the emulator's log");
    let all: Vec<_> =
        text.lines().filter_map(written).filter(|(unit, ..)| unit.starts_with("GPIO") || *unit == "RCC").collect();
    // Newer emulators have something of a clock unit, and say nothing of it.
    let has_clock = !all.iter().any(|(unit, ..)| *unit == "RCC");
    let wanted: Vec<_> = WRITTEN.into_iter().filter(|(unit, ..)| !has_clock || *unit != "RCC").collect();
    let found = all.iter().take(wanted.len()).copied();
    for ((unit, offset, value, meaning), found) in wanted.iter().zip(found) {
        assert_eq!(found, (*unit, *offset, *value), "{unit} {offset:#x}, {meaning}: found {:#x}", found.2);
    }
    // Behind that, USB's unit is asked and given up, and the chip select works.
    let rest = &all[wanted.len().min(all.len())..];
    let others: Vec<_> = rest
        .iter()
        .filter(|write| !matches!(write, ("RCC", 0x34, 0x80 | 0) | ("GPIOA", 0x18, 0x10 | 0x10_0000)))
        .collect();
    assert!(others.is_empty() && all.len() >= wanted.len(), "{others:x?}");
    assert!(rest.contains(&("GPIOA", 0x18, 0x10_0000)), "the converter was asked");
}

#[test]
fn each_edge_of_data_ready_interrupts_and_without_a_converter_none_is_a_sample() {
    const PULSES: u32 = 300;
    let Some(mut held) = Held::start() else { return };
    let mut session = held.go();
    let chip = CHIPS.into_iter().find(|chip| held.set_data_ready(chip, true)).expect("the emulator has the chip");
    let begun = wait_for_health(&mut session);
    let before = session.health().unwrap();
    for _ in 0..PULSES {
        held.set_data_ready(chip, false);
        held.set_data_ready(chip, true);
        // So that the processor gets its turn between two edges.
        session.ping().unwrap();
    }
    let ended = wait_for_health(&mut session);
    let runs = session.health().unwrap().sampler_runs.wrapping_sub(before.sampler_runs);
    // What was looked at last may be that old on either side.
    let idle = (ended.wrapping_sub(begun) + 2 * LOOK_US).div_ceil(IDLE_US);
    println!("{runs} runs of the sampler for {PULSES} pulses, at most {idle} of them without an edge");
    // This emulator interrupts on both edges of a line, whichever was chosen.
    assert!(runs >= PULSES - PULSES / 10, "{runs} for {PULSES}");
    assert!(runs <= 2 * PULSES + idle, "{runs} for {PULSES} and {idle}");
    assert_eq!(session.device_counters().unwrap().samples, 0);
    assert_eq!(session.hello().front_end.id_word, 0);
    assert!(session.start().is_err(), "nothing to stream");
}

/// Waits, in the device's time, until what it says of its health is from now on; gives the time.
fn wait_for_health(session: &mut Session) -> u32 {
    let begun = device_time_us(session);
    loop {
        let now = device_time_us(session);
        if now.wrapping_sub(begun) > LOOK_US {
            return now;
        }
    }
}

fn device_time_us(session: &mut Session) -> u32 {
    match session.request(Request::Ping) {
        Ok(Outcome::Pong { time }) => time.0,
        other => panic!("{other:?}"),
    }
}
