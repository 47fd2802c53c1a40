//! The simulated finger, from a force on its disk to bytes on its SPI bus.
