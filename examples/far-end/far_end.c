#include "far_end.h"

#include <string.h>

#include "sha256.h"

static const char *const NAMES[] = {
    "too_short", "too_long", "foreign",   "version", "length", "forged",   "malformed", "not_finite",  "out_of_range",  "life",
    "recipient", "valves",   "late",      "early",   "repeated", "old",    "old_session", "second_sender", "in_motion", "accepted",
};

const char *fe_name(fe_result result) { return NAMES[result]; }

static uint64_t number(const uint8_t *bytes, int count)
{
    uint64_t value = 0;
    while (count-- > 0)
        value = value << 8 | bytes[count];
    return value;
}

static void put(uint8_t *bytes, uint64_t value, int count)
{
    for (int i = 0; i < count; i++, value >>= 8)
        bytes[i] = (uint8_t)value;
}

static uint64_t sum(uint64_t a, uint64_t b) { return a > UINT64_MAX - b ? UINT64_MAX : a + b; }

/* Whether two codes are the same, in a time that does not depend on them. */
static bool is_code(const uint8_t *a, const uint8_t *b)
{
    uint8_t differ = 0;
    for (int i = 0; i < FE_CODE; i++)
        differ |= a[i] ^ b[i];
    return differ == 0;
}

static fe_result read_form(const uint8_t *bytes, size_t count, const uint8_t key[FE_KEY])
{
    uint8_t code[FE_CODE];
    if (count < FE_ORDER + FE_CODE)
        return FE_TOO_SHORT;
    if (count > FE_LONGEST_ORDER)
        return FE_TOO_LONG;
    if (memcmp(bytes, "SPDG", 4) != 0)
        return FE_FOREIGN;
    if (bytes[4] != 1)
        return FE_VERSION;
    if (bytes[48] > FE_VALVES || count != (size_t)FE_ORDER + 4u * bytes[48] + FE_CODE)
        return FE_LENGTH;
    hmac_sha256(key, FE_KEY, bytes, count - FE_CODE, code);
    return is_code(code, bytes + count - FE_CODE) ? FE_ACCEPTED : FE_FORGED;
}

fe_result fe_decode(const uint8_t *bytes, size_t count, const uint8_t key[FE_KEY], fe_message *message)
{
    const uint32_t one = 0x3f800000, infinite = 0x7f800000; /* bits of 1 and of infinity, IEEE 754 */
    fe_result form = read_form(bytes, count, key);
    if (form != FE_ACCEPTED)
        return form;
    /* Only a holder of the key gets here. */
    fe_message m = {.order = bytes[6] <= 2 ? (fe_order)bytes[6] : FE_HOLD, .valves = bytes[48]};
    if (bytes[6] > 2 || bytes[7] > 1 || bytes[5] < 1 || bytes[5] > 2)
        return FE_MALFORMED;
    m.recipient = (fe_recipient)bytes[5];
    m.safe = (fe_order)bytes[7];
    m.started = number(bytes + 8, 8);
    m.nonce = number(bytes + 16, 8);
    m.sequence = number(bytes + 24, 8);
    m.stamp = number(bytes + 32, 8);
    m.life = 1000 * number(bytes + 40, 4);
    m.reasons = (uint32_t)number(bytes + 44, 4);
    bool is_range = true, is_sound = true;
    for (int i = 0; i < m.valves; i++) {
        uint32_t bits = (uint32_t)number(bytes + FE_ORDER + 4 * i, 4);
        if ((bits & infinite) == infinite)
            return FE_NOT_FINITE;
        is_range &= bits <= one; /* a sign is a bit above: minus zero is another encoding of zero */
        is_sound &= m.order == FE_FOLLOW || bits == 0;
        memcpy(&m.duty[i], &bits, sizeof bits);
    }
    if (!is_range)
        return FE_OUT_OF_RANGE;
    if (m.life < 1000 || m.life > 1000000000)
        return FE_LIFE;
    if (m.recipient == FE_FOR_BEAM)
        is_sound &= m.order != FE_VENT && m.safe == FE_HOLD && m.valves == 0;
    if (number(bytes + 49, 3) != 0 || !is_sound)
        return FE_MALFORMED;
    *message = m;
    return FE_ACCEPTED;
}

static void begin(fe_receiver *r, fe_recipient recipient, uint8_t valves, fe_order idle, uint64_t within, uint64_t ramp)
{
    memset(r, 0, sizeof *r);
    r->recipient = recipient;
    r->valves = valves;
    r->idle = idle;
    r->within = within;
    r->ramp = ramp;
}

void fe_begin(fe_far_end *far, const uint8_t key[FE_KEY], uint8_t valves, fe_order idle, uint64_t within, uint64_t ramp)
{
    memset(far, 0, sizeof *far);
    memcpy(far->key, key, FE_KEY);
    begin(&far->valves, FE_FOR_VALVES, valves, idle, within, ramp);
    begin(&far->beam, FE_FOR_BEAM, 0, FE_HOLD, within, 0);
}

/* Whether a message is taken now; `ends` and `since` are set where it is. */
static fe_result judge(const fe_receiver *r, const fe_message *m, uint64_t arrival, uint64_t *ends, uint64_t *since)
{
    if (m->recipient != r->recipient)
        return FE_RECIPIENT;
    if (m->order == FE_FOLLOW && m->valves != r->valves)
        return FE_OTHER_VALVES;
    if (m->stamp > sum(arrival, r->within))
        return FE_EARLY;
    if (sum(m->stamp, m->life) <= arrival)
        return FE_LATE;
    *ends = sum(m->stamp < arrival ? m->stamp : arrival, m->life);
    *since = arrival;
    if (r->has_last && m->started == r->last.started && m->nonce == r->last.nonce) {
        if (m->sequence == r->last.sequence)
            return FE_REPEATED;
        if (m->sequence < r->last.sequence)
            return FE_OLD;
        if (arrival < r->ends)
            *since = r->since;
        return FE_ACCEPTED;
    }
    if (r->has_last && m->started <= r->last.started)
        return FE_OLD_SESSION;
    if (r->has_last && arrival < r->ends)
        return FE_SECOND_SENDER;
    return m->order == FE_FOLLOW ? FE_IN_MOTION : FE_ACCEPTED;
}

static fe_result take(fe_receiver *r, const uint8_t *bytes, size_t count, uint64_t arrival, const uint8_t *key)
{
    fe_message m;
    uint64_t ends = 0, since = 0;
    fe_result result = fe_decode(bytes, count, key, &m);
    if (result == FE_ACCEPTED)
        result = judge(r, &m, arrival, &ends, &since);
    if (result != FE_ACCEPTED) {
        r->refused[result]++;
        return result;
    }
    bool follows = r->has_last && m.started == r->last.started && m.nonce == r->last.nonce;
    r->accepted++;
    r->in_session = follows ? r->in_session + 1 : 1;
    r->sessions += !follows;
    if (follows)
        r->missing += m.sequence - r->last.sequence - 1;
    r->has_last = true;
    r->last = m;
    r->ends = ends;
    r->since = since;
    return FE_ACCEPTED;
}

fe_result fe_receive(fe_far_end *far, const uint8_t *bytes, size_t count, uint64_t arrival)
{
    /* What is for nobody is the valves' to count. */
    bool is_beam = count > 5 && memcmp(bytes, "SPDG", 4) == 0 && bytes[5] == FE_FOR_BEAM;
    return take(is_beam ? &far->beam : &far->valves, bytes, count, arrival, far->key);
}

/* The present order, and the part of the duties that has grown. */
static fe_order act(const fe_receiver *r, uint64_t now, float *part)
{
    if (!r->has_last)
        return r->idle;
    if (now >= r->ends)
        return r->last.safe;
    uint64_t grown = now > r->since ? now - r->since : 0;
    *part = grown >= r->ramp ? 1.0f : (float)grown / (float)r->ramp;
    return r->last.order;
}

fe_doing fe_step(fe_far_end *far, uint64_t now)
{
    float part = 0, lease = 0;
    fe_doing doing = {.valves = act(&far->valves, now, &part)};
    doing.beam = doing.valves == FE_FOLLOW && act(&far->beam, now, &lease) == FE_FOLLOW;
    for (int i = 0; doing.valves == FE_FOLLOW && i < FE_VALVES; i++)
        doing.duty[i] = part * far->valves.last.duty[i];
    if (doing.valves == FE_VENT && far->was_on)
        doing.valves = FE_HOLD;
    far->was_on = doing.beam;
    return doing;
}

size_t fe_acknowledge(const fe_far_end *far, const fe_doing *doing, uint64_t started, uint64_t nonce, uint64_t acknowledgement,
                      uint64_t now, const float *pressure, uint8_t bladders,
                      uint8_t bytes[FE_LONGEST_ACKNOWLEDGEMENT])
{
    const fe_receiver *r = &far->valves;
    const fe_message *last = &r->last; /* zeros before the first */
    uint64_t refused = 0;
    if (bladders > FE_PRESSURES)
        bladders = FE_PRESSURES;
    for (int i = 0; i < bladders; i++)
        if (!(pressure[i] - pressure[i] == 0))
            bladders = 0;
    for (int i = 0; i < FE_ACCEPTED; i++)
        refused += r->refused[i];
    memcpy(bytes, "SPDA\1", 5);
    bytes[5] = (uint8_t)doing->valves;
    bytes[6] = doing->beam;
    bytes[7] = bladders;
    const uint64_t numbers[10] = {last->started, last->nonce, last->sequence, last->stamp, r->in_session,
                                  refused,       started,     nonce,          acknowledgement, now};
    for (int i = 0; i < 10; i++)
        put(bytes + 8 + 8 * i, numbers[i], 8);
    for (int i = 0; i < bladders; i++) {
        uint32_t bits;
        memcpy(&bits, &pressure[i], sizeof bits);
        put(bytes + FE_ACKNOWLEDGEMENT + 4 * i, bits, 4);
    }
    size_t end = FE_ACKNOWLEDGEMENT + 4u * bladders;
    hmac_sha256(far->key, FE_KEY, bytes, end, bytes + end);
    return end + FE_CODE;
}

bool fe_parse_key(const char *text, size_t count, uint8_t key[FE_KEY])
{
    int digits = 0;
    bool is_comment = false, is_start = true, is_uniform = true;
    for (size_t i = 0; i < count; i++) {
        char c = text[i];
        is_comment = is_start ? c == '#' : is_comment;
        is_start = c == '\n';
        if (is_comment || c == '\n' || c == '\r' || c == ' ' || c == '\t')
            continue;
        int digit = c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
        if (digit < 0 || digits == 2 * FE_KEY)
            return false;
        key[digits / 2] = (uint8_t)(digits % 2 ? key[digits / 2] << 4 | digit : digit);
        digits++;
    }
    for (int i = 0; digits == 2 * FE_KEY && i < FE_KEY; i++)
        is_uniform &= key[i] == key[0];
    return digits == 2 * FE_KEY && !is_uniform;
}
