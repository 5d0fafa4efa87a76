/* The calls of board.h on an STM32. */
#include "board.h"

#include "chip.h"
#include "clock.h"
#include "crash.h"
#include "kept.h"
#include "link.h"
#include "sampling.h"
#include "setup.h"
#include "wait.h"

#define STEPS 4096.0f
#define PI 3.14159265f

/* The unit phasor of a loop with a phase lag of `rad`, and what a mode's converters add to it. */
#define LAG(rad) {__builtin_cosf(rad), -__builtin_sinf(rad)}
#define CONVERTER_LAG(mode) LAG(2.0f * PI * DRIVE_HZ * CONVERTER_LAG_S(mode))

/* LSI / 4 / (80 + 1): 10 ms, 7 to 19 over the oscillator's tolerance of 17 to 47 kHz. */
#define WATCHDOG_RELOAD 80

static bool sampling; /* what wakes the main loop */

static enum hd_reset_cause reset_cause(void)
{
    uint32_t flags = RESET_FLAGS;
    RESET_FLAGS |= CSR_RMVF;
    /* Whatever resets the chip also pulls the pin, and power-up sets the brown-out's flag too. */
    if (flags & CSR_LPWRRSTF) {
        return HD_RESET_LOW_POWER;
    }
    if (flags & (CSR_IWDGRSTF | CSR_WWDGRSTF)) {
        return HD_RESET_WATCHDOG;
    }
    if (flags & CSR_SFTRSTF) {
        return HD_RESET_SOFTWARE;
    }
    if (flags & CSR_POWER_UP) {
        return HD_RESET_POWER;
    }
    if (flags & CSR_BROWN_OUT) {
        return HD_RESET_BROWN_OUT;
    }
    return flags & CSR_PINRSTF ? HD_RESET_PIN : HD_RESET_UNKNOWN;
}

/* A bijection: consecutive counts give different identities (the finaliser of MurmurHash3). */
static uint32_t mix(uint32_t x)
{
    x = (x ^ x >> 16) * 0x85EBCA6Bu;
    x = (x ^ x >> 13) * 0xC2B2AE35u;
    return x ^ x >> 16;
}

static uint32_t next_boot_id(void)
{
    kept.boots++;
    kept.boot_id = mix(kept.boots + mix(UNIQUE_ID[0] ^ mix(UNIQUE_ID[1] ^ mix(UNIQUE_ID[2]))));
    return kept.boot_id;
}

static void describe_converters(hd_converters_t *converters)
{
    static const float amplifier_v_per_v[HD_MODES] = AMPLIFIER_V_PER_V;
    static const float sensor_um_per_v[HD_MODES] = SENSOR_UM_PER_V;
    converters->drive_hz = DRIVE_HZ;
    converters->control_hz = CONTROL_HZ;
    for (int k = 0; k < HD_MODES; k++) {
        converters->volts_per_lsb[k] = REFERENCE_V / STEPS * amplifier_v_per_v[k];
        converters->um_per_lsb[k] = REFERENCE_V / STEPS * sensor_um_per_v[k];
    }
}

static void describe_mode(hd_mode_model_t *model, int k)
{
    static const float mode_hz[HD_MODES] = MODE_HZ, quality[HD_MODES] = QUALITY, held_um[HD_MODES] = HELD_UM;
    static const hd_phasor_t loop[HD_MODES] = LOOP, converters[HD_MODES] = MODES_OF(CONVERTER_LAG);
    hd_phasor_t decay = {PI * mode_hz[k] / quality[k], 2.0f * PI * (mode_hz[k] - DRIVE_HZ)};
    model->decay_1_s = decay.d;
    model->detuning_rad_s = decay.q;
    model->gain_um_per_v_s = held_um[k] / V_LIMIT_V * hd_magnitude(decay);
    model->loop = hd_mul(loop[k], converters[k]);
}

static void describe_board(hd_config_t *config, const hd_converters_t *converters)
{
    static const float w_limit_um[HD_MODES] = W_LIMIT_UM;
    *config = (hd_config_t){
        .control_hz = CONTROL_HZ,
        .drive_hz = DRIVE_HZ,
        .v_limit_v = V_LIMIT_V,
        .gains = {HD_LAW_DEADBEAT, 0.0f, 0.0f}, /* those that the firmware was tested with */
        .output_delay_frac = (float)((1 + TICK_CHUNKS_LATE) * HD_CHUNK) * (float)CONTROL_HZ / (float)HD_SAMPLE_HZ,
        .wiring = WIRING,
        .latch_repeated_trips = LATCH_REPEATED_TRIPS,
        .features = HD_FEATURE_SYNC,
        .baud_max = LINK_BAUD_MAX,
    };
    for (int k = 0; k < HD_MODES; k++) {
        config->w_limit_um[k] = w_limit_um[k];
        config->v_limit_v = fminf(config->v_limit_v, DAC_STEPS * converters->volts_per_lsb[k]);
        describe_mode(&config->model[k], k);
    }
}

static uint32_t reversed(uint32_t word)
{
    __asm("rbit %0, %1" : "=r"(word) : "r"(word));
    return word;
}

extern const uint32_t image_begin[], image_crc[];

/* CRC-32, as in ISO 3309, of what was flashed: make appends it to the image. */
static uint32_t crc_of_image(void)
{
    clock_on(CRC_CLOCK);
    CRC->CR = CRC_RESET;
    for (const uint32_t *word = image_begin; word < image_crc; word++) {
        CRC->DR = reversed(*word); /* the unit takes the highest bit first */
    }
    return ~reversed(CRC->DR);
}

/* The core refuses a plate without gain, and reports it to the host; the log has the reason. */
static void require(bool condition, uint8_t event, float value, hd_config_t *config)
{
    if (!condition) {
        kept_add(event, value, 0);
        config->model[0].gain_um_per_v_s = 0.0f;
    }
}

/* VDDA as the internal reference shows it; 0 if that cannot be measured. */
static float measured_supply_v(void)
{
    float sum = 0.0f;
    reference_start();
    for (int i = 0; i < REFERENCE_READINGS; i++) {
        sum += reference_reading();
    }
    reference_stop();
    return sum > 0.0f ? VREFINT_CALIBRATED_V * REFERENCE_READINGS * (float)VREFINT_CALIBRATION / sum : 0.0f;
}

/* VDDA while the board runs. What lies beyond these is farther off than REFERENCE_TOLERANCE. */
static uint32_t least_reading, most_reading;

static void prepare_reference_watch(void)
{
    float at_reference_v = VREFINT_CALIBRATED_V * (float)VREFINT_CALIBRATION / REFERENCE_V;
    least_reading = (uint32_t)(at_reference_v / (1.0f + REFERENCE_TOLERANCE));
    most_reading = (uint32_t)(at_reference_v / (1.0f - REFERENCE_TOLERANCE)) + 1u;
}

static inline void watch_reference(void)
{
    static uint8_t off;
    uint32_t reading = reference_glance();
    if (reading != 0) {
        off = reading < least_reading || reading > most_reading ? (uint8_t)(off + 1) : 0;
        if (off == REFERENCE_READINGS) {
            sampling_forbid_drive();
        }
    }
}

static bool watch_supply(void)
{
    clock_on(PWR_CLOCK);
    (void)chip_watch_supply(); /* while it starts, the detector may report anything */
    EXTI->RTSR |= EXTI_PVD;
    EXTI->PR = EXTI_PVD;
    EXTI->IMR |= EXTI_PVD;
    NVIC_ICPR[0] = 1u << IRQ_PVD;
    NVIC_ISER[0] = 1u << IRQ_PVD; /* with the priority 0, above the chunks */
    return chip_watch_supply();
}

void board_start(hd_config_t *config, hd_converters_t *converters)
{
    enum hd_reset_cause cause = reset_cause();
    hd_log_recover(&kept.log);
    describe_converters(converters);
    describe_board(config, converters);
    config->boot_id = next_boot_id();
    config->reset_cause = (uint8_t)cause;
    clock_source_t source = clock_start();
    if (source == CLOCK_NONE) {
        crash(HD_EVENT_CRASH, 0);
    }
    require(source == CLOCK_CRYSTAL, HD_EVENT_SLOW_CLOCK, 0.0f, config);
    config->image_crc = crc_of_image();
    require(config->image_crc == *(const volatile uint32_t *)image_crc, HD_EVENT_IMAGE, 0.0f, config);
    require(chip_guards_brown_out(), HD_EVENT_BROWN_OUT_OFF, 0.0f, config);
    float supply_v = measured_supply_v();
    require(fabsf(supply_v - REFERENCE_V) <= REFERENCE_TOLERANCE * REFERENCE_V, HD_EVENT_REFERENCE, supply_v, config);
    if (REFERENCE_IS_WATCHED) {
        prepare_reference_watch();
    }
    require(watch_supply(), HD_EVENT_SUPPLY, 0.0f, config);
    config->log = kept.log;
    link_start();
}

/* A core that a debugger halts plays nothing over and over, and is reset by the watchdogs: the amplifiers' enable falls. A
 * debugger freezes them when it attaches, so this is said again and again. */
static void keep_watchdogs_running(void)
{
    STOP_SAMPLES_ON_HALT;
}

void board_run(void)
{
    keep_watchdogs_running();
    IWDG->KR = IWDG_KEY_START;
    IWDG->KR = IWDG_KEY_WRITE;
    IWDG->PR = 0;
    IWDG->RLR = WATCHDOG_RELOAD;
    (void)reaches(&IWDG->SR, IWDG_UPDATING, 0); /* fed earlier, it would start from the longest time */
    IWDG->KR = IWDG_KEY_FEED;
    sampling = true;
    clock_on(WWDG_CLOCK);
    WWDG->CFR = WWDG_UNIT;
    sampling_run();
}

uint32_t board_now_us(void)
{
    return TIM5->CNT;
}

void board_wait(void)
{
    if (sampling) {
        __asm volatile("wfi" : : : "memory");
    }
}

void board_feed_watchdog(void)
{
    keep_watchdogs_running();
    LINK_RX_RECOVER; /* as often, for the main loop comes round too often to look each time */
    IWDG->KR = IWDG_KEY_FEED;
    if (REFERENCE_IS_WATCHED) {
        watch_reference();
    }
}

void board_keep_log(const hd_log_t *log)
{
    kept.log = *log;
}
