"""A motor driver (L298N, TB6612) on the computer's own pins, by gpiozero. No dead man's switch."""
