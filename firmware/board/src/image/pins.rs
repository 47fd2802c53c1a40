//! Which pin is what, on the Olimex STM32-H405.
//!
//! | pin | function | goes to |
//! |---|---|---|
//! | PA4 | output | converter CS |
//! | PA5 | SPI1 SCK (AF5) | converter SCLK |
//! | PA6 | SPI1 MISO (AF5) | converter DOUT |
//! | PA7 | SPI1 MOSI (AF5) | converter DIN |
//! | PC3 | input with pull-up, EXTI3 | converter DRDY |
//! | PC5 | output, high | converter SYNC/RESET |
//! | PB8 to PB15 | inputs with pull-up | digital inputs 0 to 7 |
//! | PA8 | MCO1 (AF0), where the image is built so | converter CLKIN |
//! | PA9 | USART1 TX (AF7) | RX of the serial adapter |
//! | PA10 | USART1 RX with pull-up (AF7) | TX of the serial adapter |
//! | PA11 | USB D− (AF10) | the board's USB socket |
//! | PA12 | USB D+ (AF10) | the board's USB socket |
//! | PC12 | output, low is lit | the board's LED: on while the firmware runs |
//!
//! PC4 stays free: the board senses the USB supply on it.
//!
//! Source: STM32F405 datasheet (DocID022152), table 9; Olimex STM32-H405 schematic.

use stm32f4::stm32f405::{EXTI, GPIOA, GPIOB, GPIOC, RCC, SYSCFG};

/// `SYSCFG_EXTICR1`'s code for port C.
const PORT_C: u8 = 2;

/// Gives PA8 to the converter's clock.
pub(super) fn give_clock_out(a: &GPIOA) {
    a.afrh().modify(|_, w| w.afrh8().af0());
    a.ospeedr().modify(|_, w| w.ospeedr8().high_speed());
    a.moder().modify(|_, w| w.moder8().alternate());
}

/// Gives every pin its function, and EXTI3 the falling edge of DRDY.
pub(super) fn set_up(rcc: &RCC, (a, b, c): (&GPIOA, &GPIOB, &GPIOC), routing: &SYSCFG, edges: &EXTI) {
    rcc.ahb1enr().modify(|_, w| w.gpioaen().set_bit().gpioben().set_bit().gpiocen().set_bit());
    rcc.apb2enr().modify(|_, w| w.spi1en().set_bit().usart1en().set_bit().syscfgen().set_bit());

    // High before they become outputs: chip not selected, not in reset.
    a.bsrr().write(|w| w.bs4().set_bit());
    c.bsrr().write(|w| w.bs5().set_bit().br12().set_bit());
    a.afrl().modify(|_, w| w.afrl5().af5().afrl6().af5().afrl7().af5());
    a.afrh().modify(|_, w| w.afrh9().af7().afrh10().af7().afrh11().af10().afrh12().af10());
    a.pupdr().modify(|_, w| w.pupdr10().pull_up());
    a.ospeedr().modify(|_, w| w.ospeedr4().high_speed().ospeedr5().high_speed().ospeedr7().high_speed());
    a.ospeedr().modify(|_, w| w.ospeedr11().very_high_speed().ospeedr12().very_high_speed());
    a.moder().modify(|_, w| {
        w.moder4().output();
        w.moder5().alternate().moder6().alternate().moder7().alternate();
        w.moder9().alternate().moder10().alternate().moder11().alternate().moder12().alternate()
    });
    // Inputs after a reset.
    b.pupdr().modify(|_, w| {
        w.pupdr8().pull_up().pupdr9().pull_up().pupdr10().pull_up().pupdr11().pull_up();
        w.pupdr12().pull_up().pupdr13().pull_up().pupdr14().pull_up().pupdr15().pull_up()
    });
    c.pupdr().modify(|_, w| w.pupdr3().pull_up());
    c.moder().modify(|_, w| w.moder3().input().moder5().output().moder12().output());

    // SAFETY: a code of four bits that names a port of this chip.
    #[expect(unsafe_code, reason = "the register's numeric fields are not checked by the access crate")]
    routing.exticr1().modify(|_, w| unsafe { w.exti3().bits(PORT_C) });
    edges.ftsr().modify(|_, w| w.tr3().set_bit());
    edges.imr().modify(|_, w| w.mr3().set_bit());
}
