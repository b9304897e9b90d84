// serial-line: mbot-agent drives an Arduino with an L298N or TB6612 (docs/other-robots.md). A line
// that was obeyed comes back as it is, a torn or refused one does not.     V  answers NAME
// D-120+080  left and right, -255..255                                     S  stops
// A          may drive, until a reset or until nothing has come for TIMEOUT_MS while it drove

#define TIMEOUT_MS 300 // mbot-agent repeats a command every 100 ms
#define NAME "serial-line 1 300ms"
const uint8_t PINS[] = {6, 7, 2, 5, 4, 3}; // left: PWM, forward, backward; right: the same
char line[10];                             // the longest one and its end
uint8_t size;
bool armed, moving;
unsigned long drivenAt;

void turn(const uint8_t *pins, int speed) {
    digitalWrite(pins[1], speed > 0);
    digitalWrite(pins[2], speed < 0);
    analogWrite(pins[0], abs(speed));
}

void drive(int left, int right) {
    turn(PINS, left);
    turn(PINS + 3, right);
    moving = left || right;
    drivenAt = millis();
}

bool obey() {
    int left = 0, right = 0;
    char whole[16]; // what this line must be, to the letter
    if (!strcmp(line, "A")) {
        armed = true;
    } else if (strcmp(line, "S")) {
        sscanf(line, "D%4d%4d", &left, &right);
        snprintf(whole, sizeof whole, "D%+04d%+04d", left, right);
        if (strcmp(line, whole) || abs(left) > 255 || abs(right) > 255) return false;
        if (!armed && (left || right)) return false;
    }
    drive(left, right);
    return true;
}

void setup() {
    for (uint8_t i = 0; i < sizeof PINS; i++) pinMode(PINS[i], OUTPUT);
    Serial.begin(115200);
    Serial.println("boot " NAME);
}

void loop() {
    if (moving && millis() - drivenAt >= TIMEOUT_MS) {
        drive(0, 0);
        armed = false;
    }
    if (!Serial.available()) return;
    char byte = Serial.read();
    if (byte != '\n') {
        if (byte != '\r' && size < sizeof line) line[size++] = byte;
        return;
    }
    line[size < sizeof line ? size : 0] = 0; // one that is too long is none
    if (!strcmp(line, "V") || obey()) Serial.println(line[0] == 'V' ? NAME : line);
    size = 0;
}
